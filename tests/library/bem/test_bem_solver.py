"""The solver: conditions of contact, robustness, and what it refuses."""

import importlib
import sys

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine
from gstlib.bem import ContactInputError, ConvergenceError, HalfSpace, solve_contact, transforms
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize("size", [(50, 63), (160, 160)])  # exact, and split in two
def test_both_libraries_transform_alike(monkeypatch, size):
    pressure = np.random.default_rng(1).random(size)
    found = []
    for has in (True, False):
        monkeypatch.setattr(transforms, "HAS_DUCC0", has)
        found.append(HalfSpace(size, 0.01, MODULUS).displacement(pressure))
    assert np.allclose(*found, rtol=1e-12)


def test_a_scipy_that_has_moved_its_transforms_will_do(monkeypatch):
    private = "scipy.fft._pocketfft.pypocketfft"
    lines, found = np.random.default_rng(2).random((3, 16)), []
    with monkeypatch.context() as patched:
        for has in (True, False):
            if not has:
                patched.setitem(sys.modules, private, None)
            importlib.reload(transforms)
            patched.setattr(transforms, "HAS_DUCC0", False)
            waves, back = np.empty((3, 9), complex), np.empty((3, 16))
            transforms.to_waves(lines, waves)
            transforms.from_waves(waves, back)
            assert np.allclose(back, lines)
            found.append(waves)
    importlib.reload(transforms)
    np.testing.assert_array_equal(*found)


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


@pytest.mark.parametrize(
    ("load", "convolutions"), [({"mean_pressure": 76.0}, 22), ({"displacement": 0.015}, 23)]
)
def test_convolutions_stay_few(load, convolutions):
    # Guards the preconditioner (its short range alone: 28 and 25) and the nested start.
    heights = self_affine(512, seed=1)
    state = solve_contact(heights, 0.85 / 512, MODULUS, tolerance=1e-8, **load)
    assert state.convolutions <= convolutions


@pytest.mark.parametrize(("seed", "spiky"), [(525, True), (11103, True), (12562, False)])
def test_cycles_are_broken(seed, spiky):
    # Surfaces of a search by chance on which bold steps alone go round in circles.
    rng = np.random.default_rng(seed)
    shape = int(rng.integers(2, 30)), int(rng.integers(2, 90))
    heights = rng.standard_normal(shape)
    heights = 0.01 * (np.exp(heights) if spiky else heights)
    load = float(10 ** rng.uniform(1, 4))
    state = solve_contact(heights, 0.01, MODULUS, mean_pressure=load)
    assert state.residual <= 1e-6
    assert state.iterations <= 100


@pytest.mark.parametrize("limit", [np.inf, 100.0])
@pytest.mark.parametrize("summits", [1, 4])
@pytest.mark.parametrize("mean_pressure", [1e-20, 1e-6])
def test_the_least_load_is_carried_by_the_highest_elements(mean_pressure, summits, limit):
    heights = self_affine(100, seed=2)
    heights.reshape(-1)[:summits] = heights.max() + 1e-3
    load = {"mean_pressure": mean_pressure, "pressure_cap": limit}
    state = solve_contact(heights, 0.01, MODULUS, **load)
    assert np.flatnonzero(state.pressure).tolist() == list(range(summits))
    assert state.mean_pressure == pytest.approx(mean_pressure, rel=1e-12)
    assert state.residual <= 1e-6


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
@given(surfaces, st.floats(1e-4, 1e-2), st.integers(0, 2**32 - 1))
def test_the_start_does_not_matter(heights, displacement, seed):
    start = np.random.default_rng(seed).exponential(1e4, heights.shape)
    state = solve_contact(
        heights, 0.01, MODULUS, displacement=displacement, initial_pressure=start, tolerance=1e-11
    )
    assert_same(state.pressure, pressure_of(heights, displacement))


@pytest.mark.parametrize("limit", [np.inf, 300.0])
@pytest.mark.parametrize("scale", [1e-320, 1e30])
def test_a_start_may_be_far_from_the_force(scale, limit):
    heights = self_affine(24, seed=3)
    start = scale * np.random.default_rng(0).random(heights.shape)
    load = {"mean_pressure": 20.0, "pressure_cap": limit, "tolerance": 1e-9}
    found, expected = (
        solve_contact(heights, 0.01, MODULUS, initial_pressure=given, **load).pressure
        for given in (start, None)
    )
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_start_is_left_alone_and_its_memory_layout_does_not_matter(order):
    heights, load = self_affine(60), {"mean_pressure": 60.0, "tolerance": 1e-9}
    before = heights.copy()
    solved = solve_contact(heights, 0.01, MODULUS, **load)
    start = np.array(0.9 * solved.pressure, order=order)
    copy = start.copy()
    state = solve_contact(heights, 0.01, MODULUS, initial_pressure=start, **load)
    assert np.array_equal(start, copy)
    assert np.array_equal(heights, before)
    assert state.iterations == 0
    assert state.mean_pressure == pytest.approx(60.0, rel=1e-12)


def test_a_start_that_is_good_enough_is_still_recomputed_exactly():
    heights = self_affine(100)
    load = {"mean_pressure": 30.0}
    start = solve_contact(heights, 0.01, MODULUS, tolerance=1e-3, **load).pressure
    state = solve_contact(heights, 0.01, MODULUS, tolerance=0.1, initial_pressure=start, **load)
    assert 1e-5 < state.residual < 1e-3
    field = HalfSpace(heights.shape, 0.01, MODULUS).displacement(state.pressure)
    gap = field - (state.displacement - (heights.max() - heights))
    np.testing.assert_allclose(state.gap, gap, atol=1e-12 * state.displacement)


HOLED = np.zeros((4, 4))
HOLED[1, 2] = np.nan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heights": HOLED}, "1 values that are NaN"),
        ({"heights": np.zeros(5)}, "shape"),
        ({"heights": np.ma.masked_array(np.zeros((4, 4)), np.eye(4))}, "masked"),
        ({"heights": np.eye(4), "spacing": 1e-200}, "are both in mm"),
        ({"spacing": -0.1}, "spacing"),
        ({"contact_modulus": np.nan}, "contact_modulus"),
        ({"displacement": None}, "exactly one"),
        ({"displacement": "deep"}, "displacement"),
        ({"displacement": None, "mean_pressure": -1.0}, "mean_pressure"),
        ({"displacement": None, "mean_pressure": 9.0, "pressure_cap": 9.0}, "not below"),
        ({"pressure_cap": 0}, "pressure_cap"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"initial_pressure": np.zeros((4, 5))}, r"\(4, 5\)"),
        ({"initial_pressure": np.full((4, 4), -1.0)}, "initial_pressure"),
    ],
)
def test_bad_input_is_refused(change, message):
    arguments = {
        "heights": np.zeros((4, 4)),
        "spacing": 0.1,
        "contact_modulus": 1e4,
        "displacement": 1e-3,
    } | change
    surface = [arguments.pop(name) for name in ("heights", "spacing", "contact_modulus")]
    with pytest.raises(ContactInputError, match=message):
        solve_contact(*surface, **arguments)


def test_a_spike_that_coarser_grids_do_not_touch():
    """Averaging lowers it out of reach, on 128 elements a side too."""
    heights = np.zeros((256, 256))
    heights[100, 77] = 0.1
    state = solve_contact(heights, 1e-3, 1e4, displacement=1e-3)
    assert np.flatnonzero(state.pressure).tolist() == [100 * 256 + 77]
    own = 4 * np.arcsinh(1) * 1e-3 / (np.pi * 1e4)
    assert state.pressure.max() == pytest.approx(1e-3 / own, rel=1e-6)


@pytest.mark.parametrize(("size", "spike"), [(64, 30), (131, 130)])
def test_the_load_is_carried_though_the_start_cannot(size, spike):
    """The start, given or from a coarser grid, is in contact where the limit forbids the load."""
    heights = np.zeros((size, size))
    heights[spike, spike] = 1.0
    limit = 100.0
    pressure = 3 * limit / size**2  # the spike alone bears a third
    load = {"mean_pressure": pressure, "pressure_cap": limit}
    for initial in (None, np.where(heights > 0, 1.0, 0.0)):
        state = solve_contact(heights, 0.01, 1e4, initial_pressure=initial, **load)
        assert state.mean_pressure == pytest.approx(pressure, rel=1e-12)
        assert state.pressure[spike, spike] == limit


def test_elements_sixty_times_as_long_as_wide_under_a_pressure_limit():
    # Bold steps alone go round in circles here.
    heights = 1e-3 * (np.add.outer(np.arange(288) // 3, np.arange(214) // 5) % 2)
    state = solve_contact(
        heights, (0.01, 0.6), 1e4, mean_pressure=12.57, pressure_cap=100.0, tolerance=1e-6
    )
    assert state.residual <= 1e-6
    assert state.pressure.max() == 100.0


def test_what_does_not_converge_raises_with_residual_and_remedy():
    with pytest.raises(ConvergenceError, match=r"residual .*e-1.* after 500 .* Set a tolerance"):
        solve_contact(self_affine(40), 0.01, MODULUS, mean_pressure=500.0, tolerance=1e-18)
