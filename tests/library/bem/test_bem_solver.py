"""The solver: conditions of contact, a cap, robustness, and the input that it refuses."""

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import lsq_linear

from gstlib.bem import ContactInputError, ConvergenceError, solve_contact


@pytest.mark.parametrize("tolerance", [1e-9, 0.1])
@pytest.mark.parametrize(
    ("shape", "spacing"), [((13, 22), (0.01, 0.017)), ((1, 30), 0.01)]
)
@pytest.mark.parametrize(
    ("name", "value"), [("displacement", 0.004), ("mean_pressure", 60.0)]
)
def test_contact_conditions_hold_by_an_independent_matrix(
    shape, spacing, name, value, tolerance
):
    heights = 0.003 * np.random.default_rng(3).standard_normal(shape)
    options = {name: value, "tolerance": tolerance}
    state = solve_contact(heights, spacing, MODULUS, **options)
    field = dense_matrix(shape, spacing) @ state.pressure.ravel()
    gap = field.reshape(shape) + heights.max() - heights - state.displacement
    contact = state.pressure > 0
    worst = max(gap[contact].max(), -gap.min()) / state.displacement
    assert state.residual == pytest.approx(worst, abs=1e-13)
    assert state.residual <= tolerance
    assert_allclose(state.gap, gap, atol=1e-12 * state.displacement)
    assert state.contact_fraction == contact.mean()
    assert getattr(state, name) == pytest.approx(value, rel=1e-13)


def test_convolutions_stay_few():
    # Guards the preconditioner (its short range alone: 29) and the nested start.
    heights = self_affine(512, seed=1)
    options = {"mean_pressure": 76.0, "tolerance": 1e-8}
    assert solve_contact(heights, 0.85 / 512, MODULUS, **options).convolutions <= 22


@pytest.mark.parametrize(
    ("seed", "is_spiky"), [(525, True), (11103, True), (12562, False)]
)
def test_cycles_are_broken(seed, is_spiky):
    # Surfaces of a search by chance on which bold steps alone go round in circles.
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(2, 30)), int(rng.integers(2, 90))
    heights = rng.standard_normal(shape)
    heights = 0.01 * (np.exp(heights) if is_spiky else heights)
    load = float(10 ** rng.uniform(1, 4))
    state = solve_contact(heights, 0.01, MODULUS, mean_pressure=load)
    assert state.residual <= 1e-6
    assert state.iterations <= 100


@pytest.mark.parametrize(
    ("mean_pressure", "summits", "limit"), [(1e-20, 1, 100.0), (1e-6, 4, np.inf)]
)
def test_the_least_load_is_carried_by_the_highest_elements(
    mean_pressure, summits, limit
):
    heights = self_affine(100, seed=2)
    heights.reshape(-1)[:summits] = heights.max() + 1e-3
    load = {"mean_pressure": mean_pressure, "pressure_cap": limit}
    state = solve_contact(heights, 0.01, MODULUS, **load)
    assert np.flatnonzero(state.pressure).tolist() == list(range(summits))
    assert state.mean_pressure == pytest.approx(mean_pressure, rel=1e-12)
    assert state.residual <= 1e-6


CAPPED = {"mean_pressure": 20.0, "pressure_cap": 300.0}


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(2, 24), st.integers(2, 24)),
    st.sampled_from([(1e4, {"displacement": 2e-3}), (1e-320, CAPPED), (1e30, CAPPED)]),
)
def test_the_start_does_not_matter(seed, shape, case):
    """However far it is from the force, and in whatever order of memory."""
    rng = np.random.default_rng(seed)
    surface = 0.002 * rng.standard_normal(shape), 0.01, MODULUS
    scale, load = case
    cold = solve_contact(*surface, tolerance=1e-11, **load).pressure
    start = np.asfortranarray(scale * rng.exponential(1.0, shape))
    before = start.copy()
    warm = solve_contact(
        *surface, tolerance=1e-9, initial_pressure=start, **load
    ).pressure
    assert_allclose(warm, cold, atol=1e-5 * cold.max())
    assert_array_equal(start, before)


SMALL = self_affine(14, seed=5, length=0.028, rms=0.002, roll_off=0.02)


@pytest.mark.parametrize("limit", [200.0, 2000.0])
def test_agrees_with_doubly_bounded_least_squares(limit):
    # min ½ pᵀKp − pᵀw is the least-squares problem of Bemporad & Paggi (2015): with K = LLᵀ,
    # min |Lᵀp − L⁻¹w|² over 0 ≤ p ≤ H.
    factor = np.linalg.cholesky(dense_matrix(SMALL.shape, 0.002))
    overlap = 0.004 - (SMALL.max() - SMALL.ravel())
    right = np.linalg.solve(factor, overlap)
    bounded = lsq_linear(factor.T, right, (0, limit), method="bvls", tol=1e-14)
    expected = bounded.x.reshape(SMALL.shape)
    peak = expected.max()
    options = {"pressure_cap": limit, "tolerance": 1e-11}
    state = solve_contact(SMALL, 0.002, MODULUS, displacement=0.004, **options)
    assert_allclose(state.pressure, expected, atol=1e-8 * peak)
    assert state.pressure.max() <= limit


@pytest.mark.parametrize("excess", np.logspace(-4, -2, 6))
def test_converges_where_nearly_all_is_at_the_limit(excess):
    y, x = np.mgrid[:12, :19]
    heights = -0.01 * ((y - 6) ** 2 + (x - 9.5) ** 2)
    for mean in (0.01, 0.1, 1.0):
        load = {"mean_pressure": mean, "pressure_cap": mean * (1 + excess)}
        state = solve_contact(heights, 0.1, 1e3, tolerance=1e-9, **load)
        assert state.residual <= 1e-9
        assert state.pressure.max() <= load["pressure_cap"]
        assert state.mean_pressure == pytest.approx(mean, rel=1e-12)


HOLED = np.zeros((4, 4))
HOLED[1, 2] = np.nan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heights": HOLED}, "1 values that are NaN"),
        ({"heights": np.ma.masked_array(HOLED, np.eye(4))}, "masked"),
        ({"heights": np.eye(4), "spacing": 1e-200}, "are both in mm"),
        ({"layer": 20}, "gstlib.Layer, got 20"),
        ({"displacement": None}, "exactly one"),
        ({"initial_pressure": np.full((4, 4), -1.0)}, "initial_pressure"),
    ],
)
def test_bad_input_is_refused(change, message):
    surface = {"heights": np.zeros((4, 4)), "spacing": 0.1, "contact_modulus": 1e4}
    with pytest.raises(ContactInputError, match=message):
        solve_contact(**(surface | {"displacement": 1e-3} | change))


def test_a_spike_that_coarser_grids_do_not_touch():
    """Averaging lowers it out of reach, on 128 elements a side too."""
    heights = np.zeros((256, 256))
    heights[100, 77] = 0.1
    state = solve_contact(heights, 1e-3, 1e4, displacement=1e-3)
    assert np.argwhere(state.pressure).tolist() == [[100, 77]]
    own = 4 * np.arcsinh(1) * 1e-3 / (np.pi * 1e4)
    assert state.pressure.max() == pytest.approx(1e-3 / own, rel=1e-6)


@pytest.mark.parametrize("is_cold", [True, False])
def test_the_load_is_carried_though_the_start_cannot(is_cold):
    """The start, given or from a coarser grid, is in contact where the limit forbids the load."""
    heights = np.zeros((131, 131))
    heights[-1, -1] = 1.0
    start = None if is_cold else heights
    pressure = 300.0 / heights.size  # the spike alone bears a third
    load = {"mean_pressure": pressure, "pressure_cap": 100.0}
    state = solve_contact(heights, 0.01, 1e4, initial_pressure=start, **load)
    assert state.mean_pressure == pytest.approx(pressure, rel=1e-12)
    assert state.pressure[-1, -1] == 100.0


def test_a_contact_that_does_not_converge_raises_with_residual_and_remedy():
    with pytest.raises(
        ConvergenceError, match=r"residual .*e-1.* after 500 .* Set a tolerance"
    ):
        solve_contact(
            self_affine(20), 0.01, MODULUS, mean_pressure=500.0, tolerance=1e-18
        )
