import dataclasses
import warnings

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine, sphere
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from gstlib.bem import (
    ConvergenceError,
    DomainTooSmallWarning,
    InvalidContactInput,
    solve_contact,
)

pytestmark = pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")


def violation(pressure, heights, spacing, displacement, modulus=MODULUS):
    """Largest violation of the contact conditions by a dense matrix of the tests' own."""
    field = (dense_matrix(heights.shape, spacing, modulus) @ pressure.ravel()).reshape(
        heights.shape
    )
    gap = field - (displacement - (heights.max() - heights))
    contact = pressure > 0
    worst = max(abs(gap[contact]).max(initial=0), -gap[~contact].min(initial=0))
    return worst / displacement, gap


@pytest.mark.parametrize("shape", [(20, 20), (13, 22), (1, 30), (24, 3)])
@pytest.mark.parametrize("spacing", [0.01, (0.01, 0.017)])
@pytest.mark.parametrize("load", [{"displacement": 0.004}, {"mean_pressure": 60.0}])
def test_contact_conditions_hold_by_an_independent_matrix(shape, spacing, load):
    heights = 0.003 * np.random.default_rng(3).standard_normal(shape)
    state = solve_contact(heights, spacing, MODULUS, tolerance=1e-9, **load)
    worst, gap = violation(state.pressure, heights, spacing, state.displacement)
    assert worst < 1.01e-9
    assert state.residual <= 1e-9
    assert state.residual == pytest.approx(worst, abs=1e-13)
    np.testing.assert_allclose(state.gap, gap, atol=1e-12 * state.displacement)
    assert state.pressure.min() == 0
    assert state.mean_pressure == pytest.approx(state.pressure.mean(), rel=1e-12)
    assert state.contact_fraction == (state.pressure > 0).mean()
    for name, value in load.items():
        assert getattr(state, name) == pytest.approx(value, rel=1e-13)
    assert 0 <= state.duality_gap < 1e-7


@pytest.mark.parametrize("displacement", [0.001, 0.004, 0.02])
def test_agrees_with_bounded_least_squares(displacement):
    # min ½ pᵀKp − pᵀw is the least-squares problem of Bemporad & Paggi (2015): with K = LLᵀ,
    # min |Lᵀp − L⁻¹w|² over p ≥ 0.
    heights = self_affine(24, seed=5, length=0.04, rms=0.002, cut_off=4, roll_off=0.02)
    spacing = 0.04 / 24
    factor = np.linalg.cholesky(dense_matrix(heights.shape, spacing))
    overlap = displacement - (heights.max() - heights.ravel())
    expected, _ = nnls(factor.T, np.linalg.solve(factor, overlap))
    state = solve_contact(heights, spacing, MODULUS, displacement=displacement, tolerance=1e-12)
    np.testing.assert_allclose(state.pressure.ravel(), expected, atol=1e-10 * expected.max())
    assert np.array_equal(state.contact.ravel(), expected > 0)


def test_nested_grids_and_a_cold_start_agree_on_a_rough_surface():
    heights = self_affine(150, seed=1)
    nested = solve_contact(heights, 0.85 / 150, MODULUS, mean_pressure=40.0, tolerance=1e-10)
    cold = solve_contact(
        heights,
        0.85 / 150,
        MODULUS,
        displacement=nested.displacement,
        initial_pressure=np.zeros_like(heights),
        tolerance=1e-10,
    )
    np.testing.assert_allclose(nested.pressure, cold.pressure, atol=1e-8 * cold.pressure.max())
    assert cold.mean_pressure == pytest.approx(40.0, rel=1e-9)


@pytest.mark.parametrize(
    ("load", "convolutions"), [({"mean_pressure": 76.0}, 20), ({"displacement": 0.015}, 21)]
)
def test_convolutions_stay_few(load, convolutions):
    # Guards the preconditioner (its short range alone: 28 and 25) and the nested start (first
    # residual 0.3 and more).
    heights = self_affine(512, seed=1)
    state = solve_contact(heights, 0.85 / 512, MODULUS, tolerance=1e-8, **load)
    assert state.convolutions <= convolutions
    assert state.history[0] < 0.2
    assert state.history[-1] < 1e-8
    assert len(state.history) == state.iterations


@pytest.mark.parametrize(("seed", "spiky"), [(525, True), (11103, True), (12562, False)])
def test_cycles_are_broken(seed, spiky):
    # Surfaces of a search by chance on which bold steps alone go round in circles.
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(2, 30)), int(rng.integers(2, 90))
    heights = rng.standard_normal(shape)
    heights = 0.01 * (np.exp(heights) if spiky else heights)
    load = float(10 ** rng.uniform(1, 4))
    state = solve_contact(heights, 0.01, MODULUS, mean_pressure=load, max_iterations=100)
    assert state.residual <= 1e-6


def test_hertz_converges_at_the_rate_of_the_grid():
    radius, force = 10.0, 20.0
    a = (3 * force * radius / (4 * MODULUS)) ** (1 / 3)
    peak = 3 * force / (2 * np.pi * a**2)
    errors = []
    for n in (32, 64, 128):
        spacing = 3 * a / n
        state = solve_contact(
            sphere(n, spacing, radius),
            spacing,
            MODULUS,
            mean_pressure=force / (n * spacing) ** 2,
            tolerance=1e-8,
        )
        at = (np.arange(n) - (n - 1) / 2) * spacing
        exact = peak * np.sqrt(np.maximum(1 - (at[:, None] ** 2 + at**2) / a**2, 0))
        summit = spacing**2 / (4 * radius)  # the highest element lies beside the apex
        errors.append(
            (
                np.sqrt(((state.pressure - exact) ** 2).mean()) / peak,
                abs(state.displacement + summit - a**2 / radius) / (a**2 / radius),
                abs(state.contact_fraction * (n * spacing) ** 2 / (np.pi * a**2) - 1),
            )
        )
    errors = np.array(errors)
    assert errors[-1, 0] < 2e-3
    assert errors[-1, 1] < 2e-4
    assert errors[-1, 2] < 1e-2
    # The pressure is √distance at the edge: first order in the mean square, nearly second in δ.
    rates = np.log2(errors[0] / errors[-1]) / 2
    assert rates[0] > 0.9
    assert rates[1] > 1.3


def test_square_punch_tends_to_its_stiffness():
    # PEERS.md: k = 1.1523 E* s; uniform squares give 1.14617 at 64², 1.14921 at 128².
    found = []
    for n, expected in ((64, 1.14617), (128, 1.14921)):
        state = solve_contact(
            np.zeros((n, n)), 0.85 / n, MODULUS, displacement=0.001, tolerance=1e-9
        )
        stiffness = state.mean_pressure * 0.85**2 / 0.001 / (MODULUS * 0.85)
        assert stiffness == pytest.approx(expected, abs=1e-5)
        assert state.contact_fraction == 1
        found.append(stiffness)
    assert 2 * found[1] - found[0] == pytest.approx(1.1523, abs=1e-4)


def test_single_element_of_contact():
    heights = np.zeros((9, 9))
    heights[4, 5] = 0.1
    state = solve_contact(heights, 0.01, MODULUS, displacement=1e-3, tolerance=1e-12)
    own = 4 * np.arcsinh(1) * 0.01 / (np.pi * MODULUS)
    assert np.count_nonzero(state.pressure) == 1
    assert state.pressure[4, 5] == pytest.approx(1e-3 / own, rel=1e-12)
    loaded = solve_contact(heights, 0.01, MODULUS, mean_pressure=state.mean_pressure)
    assert loaded.displacement == pytest.approx(1e-3, rel=1e-10)


def test_grid_of_one_element():
    state = solve_contact([[3.0]], 0.01, MODULUS, mean_pressure=5.0)
    assert state.pressure[0, 0] == pytest.approx(5.0)
    assert state.gap[0, 0] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("load", [{"displacement": 0}, {"mean_pressure": 0.0}])
def test_no_load_is_first_touch(load):
    heights = self_affine(20)
    state = solve_contact(heights, 0.01, MODULUS, **load)
    assert state.displacement == state.mean_pressure == state.contact_fraction == 0
    np.testing.assert_array_equal(state.gap, heights.max() - heights)


surfaces = st.builds(
    lambda seed, ny, nx: 0.002 * np.random.default_rng(seed).standard_normal((ny, nx)),
    st.integers(0, 2**32 - 1),
    st.integers(2, 24),
    st.integers(2, 24),
)
few = settings(max_examples=25, deadline=None)


def pressure_of(heights, displacement, spacing=0.01, modulus=MODULUS):
    return solve_contact(
        heights, spacing, modulus, displacement=displacement, tolerance=1e-11
    ).pressure


def assert_same(actual, expected):
    np.testing.assert_allclose(actual, expected, atol=1e-7 * expected.max())


@few
@given(surfaces, st.floats(1e-4, 1e-2))
def test_symmetry_under_flips_and_transposition(heights, displacement):
    spacing = (0.01, 0.014)
    pressure = pressure_of(heights, displacement, spacing)
    assert_same(pressure_of(heights[::-1], displacement, spacing), pressure[::-1])
    assert_same(pressure_of(heights[:, ::-1], displacement, spacing), pressure[:, ::-1])
    assert_same(pressure_of(heights.T, displacement, spacing[::-1]), pressure.T)


@few
@given(surfaces, st.floats(1e-4, 1e-2), st.floats(0.01, 100), st.floats(0.01, 100))
def test_scaling_in_modulus_length_and_height(heights, displacement, one, two):
    pressure = pressure_of(heights, displacement)
    assert_same(pressure_of(heights, displacement, modulus=one * MODULUS), one * pressure)
    assert_same(pressure_of(heights, displacement, spacing=one * 0.01), pressure / one)
    assert_same(pressure_of(two * heights, two * displacement), two * pressure)
    assert_same(pressure_of(heights + one, displacement), pressure)


@few
@given(surfaces, st.floats(1e-4, 1e-2), st.floats(1.01, 3))
def test_load_grows_with_displacement(heights, displacement, factor):
    less, more = pressure_of(heights, displacement), pressure_of(heights, factor * displacement)
    assert more.sum() > less.sum()
    # Energy is convex in δ: the mean pressure grows at least in proportion.
    assert more.sum() >= factor * less.sum() * (1 - 1e-9)


@few
@given(surfaces, st.floats(1e-4, 1e-2))
def test_load_control_is_displacement_control(heights, displacement):
    controlled = solve_contact(heights, 0.01, MODULUS, displacement=displacement, tolerance=1e-11)
    loaded = solve_contact(
        heights, 0.01, MODULUS, mean_pressure=controlled.mean_pressure, tolerance=1e-11
    )
    assert loaded.displacement == pytest.approx(displacement, rel=1e-8)
    assert_same(loaded.pressure, controlled.pressure)


@few
@given(surfaces, st.floats(1e-4, 1e-2), st.integers(0, 2**32 - 1))
def test_the_start_does_not_matter(heights, displacement, seed):
    start = np.random.default_rng(seed).exponential(1e4, heights.shape)
    state = solve_contact(
        heights, 0.01, MODULUS, displacement=displacement, initial_pressure=start, tolerance=1e-11
    )
    assert_same(state.pressure, pressure_of(heights, displacement))


def test_a_low_far_corner_changes_nothing():
    heights = sphere(64, 0.01, 5.0)
    raised = heights.copy()
    raised[:5, :5] += 0.5 * (heights.max() - raised[:5, :5].max() - 0.002)
    before = solve_contact(heights, 0.01, MODULUS, displacement=0.001, tolerance=1e-10)
    after = solve_contact(raised, 0.01, MODULUS, displacement=0.001, tolerance=1e-10)
    assert not before.contact[:5, :5].any()
    assert_same(after.pressure, before.pressure)


@pytest.mark.usefixtures("always_threads")
def test_same_bits_for_any_number_of_workers():
    heights = self_affine(100)
    one, two = (
        solve_contact(heights, 0.01, MODULUS, mean_pressure=30.0, workers=w) for w in (1, 2)
    )
    assert one.pressure.tobytes() == two.pressure.tobytes()
    assert one.gap.tobytes() == two.gap.tobytes()


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_start_is_left_alone_and_its_memory_layout_does_not_matter(order):
    heights = self_affine(20)
    solved = solve_contact(heights, 0.01, MODULUS, mean_pressure=30.0, tolerance=1e-9)
    start = np.array(0.9 * solved.pressure, order=order)
    copy = start.copy()
    state = solve_contact(
        heights, 0.01, MODULUS, mean_pressure=30.0, tolerance=1e-9, initial_pressure=start
    )
    assert np.array_equal(start, copy)
    assert state.iterations == 0
    assert state.mean_pressure == pytest.approx(30.0, rel=1e-12)


def test_heights_are_left_alone_and_the_state_is_frozen():
    heights = self_affine(16)
    copy = heights.copy()
    state = solve_contact(heights, 0.01, MODULUS, mean_pressure=30.0)
    assert np.array_equal(heights, copy)
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.residual = 0.0


HOLED = np.zeros((4, 4))
HOLED[1, 2] = np.nan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heights": HOLED}, "1 values that are NaN"),
        ({"heights": np.zeros(5)}, "shape"),
        ({"heights": np.zeros((0, 5))}, "shape"),
        ({"heights": [["a", "b"]]}, "numbers"),
        ({"spacing": -0.1}, "spacing"),
        ({"spacing": 0}, "spacing"),
        ({"spacing": (0.1, np.inf)}, "spacing"),
        ({"contact_modulus": 0}, "contact_modulus"),
        ({"contact_modulus": -1.0}, "contact_modulus"),
        ({"contact_modulus": np.nan}, "contact_modulus"),
        ({"displacement": None}, "exactly one"),
        ({"mean_pressure": 1.0}, "exactly one"),
        ({"displacement": -1e-3}, "displacement"),
        ({"displacement": np.nan}, "displacement"),
        ({"displacement": None, "mean_pressure": -1.0}, "mean_pressure"),
        ({"displacement": "deep"}, "displacement"),
        ({"tolerance": 0}, "tolerance"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"workers": 0}, "workers"),
        ({"initial_pressure": np.zeros((4, 5))}, r"\(4, 5\)"),
        ({"initial_pressure": np.full((4, 4), -1.0)}, "initial_pressure"),
        ({"initial_pressure": HOLED}, "initial_pressure"),
    ],
)
def test_bad_input_is_refused(change, message):
    arguments = {
        "heights": np.zeros((4, 4)),
        "spacing": 0.1,
        "contact_modulus": 1e4,
        "displacement": 1e-3,
    } | change
    with pytest.raises(InvalidContactInput, match=message):
        solve_contact(
            arguments.pop("heights"),
            arguments.pop("spacing"),
            arguments.pop("contact_modulus"),
            **arguments,
        )


def test_unconverged_raises_with_residual_and_remedy():
    with pytest.raises(ConvergenceError, match="max_iterations") as caught:
        solve_contact(self_affine(40), 0.01, MODULUS, mean_pressure=50.0, max_iterations=3)
    assert caught.value.residual > 1e-6
    assert caught.value.iterations == 3
    assert f"{caught.value.residual:.3g}" in str(caught.value)


def test_tolerance_below_rounding_raises_rather_than_lies():
    with pytest.raises(ConvergenceError):
        solve_contact(
            self_affine(40), 0.01, MODULUS, mean_pressure=50.0, tolerance=1e-18, max_iterations=80
        )


def test_contact_at_the_border_warns():
    heights = -sphere(32, 0.01, 5.0)  # a bowl: its corners touch first
    with pytest.warns(DomainTooSmallWarning, match="border"):
        solve_contact(heights, 0.01, MODULUS, displacement=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solve_contact(-heights, 0.01, MODULUS, displacement=1e-3)


@pytest.mark.parametrize(("shape", "border"), [((8, 8), 28), ((1, 8), 8), ((1, 1), 1)])
def test_each_element_at_the_border_counts_once(shape, border):
    with pytest.warns(DomainTooSmallWarning, match=f"on {border} elements"):
        solve_contact(np.zeros(shape), 0.01, MODULUS, mean_pressure=1.0)


def test_a_spike_that_coarser_grids_do_not_touch():
    """Averaging lowers it out of reach, on 128 elements a side too."""
    heights = np.zeros((256, 256))
    heights[100, 77] = 0.1
    state = solve_contact(heights, 1e-3, 1e4, displacement=1e-3)
    assert np.flatnonzero(state.pressure).tolist() == [100 * 256 + 77]
    assert state.residual < 1e-6


@pytest.mark.parametrize(("size", "spike"), [(64, 30), (131, 130)])
def test_the_load_is_carried_though_the_start_cannot(size, spike):
    """The start, given or from a coarser grid, is in contact where the limit forbids the load."""
    heights = np.zeros((size, size))
    heights[spike, spike] = 1.0
    limit = 100.0
    pressure = 3 * limit / size**2  # the spike alone bears a third
    start = np.where(heights > 0, 1.0, 0.0)
    for initial in (None, start):
        state = solve_contact(
            heights,
            0.01,
            1e4,
            mean_pressure=pressure,
            pressure_limit=limit,
            initial_pressure=initial,
        )
        assert state.mean_pressure == pytest.approx(pressure, rel=1e-12)
        assert state.pressure[spike, spike] == limit


@pytest.mark.parametrize("limit", [np.inf, 300.0])
@pytest.mark.parametrize("scale", [1e-320, 1e-30, 1e17, 1e30, 1e300])
def test_a_start_may_be_far_from_the_force(scale, limit):
    heights = self_affine(24, seed=3)
    start = scale * np.random.default_rng(0).random(heights.shape)
    load = {"mean_pressure": 20.0, "pressure_limit": limit, "tolerance": 1e-9}
    found, expected = (
        solve_contact(heights, 0.01, MODULUS, initial_pressure=given, **load)
        for given in (start, None)
    )
    np.testing.assert_allclose(found.pressure, expected.pressure, atol=1e-6 * 300)


def test_elements_sixty_times_as_long_as_wide_under_a_pressure_limit():
    # Bold steps alone go round in circles here.
    heights = 1e-3 * (np.add.outer(np.arange(288) // 3, np.arange(214) // 5) % 2)
    state = solve_contact(
        heights, (0.01, 0.6), 1e4, mean_pressure=12.57, pressure_limit=100.0, tolerance=1e-6
    )
    assert state.residual <= 1e-6
    assert state.pressure.max() == 100.0
