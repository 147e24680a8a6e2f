import numpy as np
import pytest
from bem_reference import MODULUS, self_affine, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.bem import InvalidContactInput, UnreachableTargetError, load_path, solve_contact

pytestmark = pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")

HEIGHTS = self_affine(80, seed=2)
SPACING = 0.85 / 80


@pytest.fixture(scope="module")
def path():
    return load_path(
        HEIGHTS,
        SPACING,
        MODULUS,
        target_pressure=40.0,
        steps=8,
        tolerance=1e-10,
        keep_states=True,
    )


def test_ends_at_the_target(path):
    assert path.mean_pressure[-1] == pytest.approx(40.0, rel=1e-13)
    assert path.final.mean_pressure == path.mean_pressure[-1]
    assert path.final.displacement == path.displacement[-1]
    direct = solve_contact(HEIGHTS, SPACING, MODULUS, mean_pressure=40.0, tolerance=1e-10)
    np.testing.assert_allclose(path.final.pressure, direct.pressure, atol=1e-12 * 40)


def test_steps_are_equal_in_displacement_and_grow(path):
    np.testing.assert_allclose(
        path.displacement, path.displacement[-1] * np.arange(1, 9) / 8, rtol=1e-14
    )
    assert np.all(np.diff(path.mean_pressure) > 0)
    assert np.all(np.diff(path.contact_fraction) >= 0)
    assert np.all(path.residual <= 1e-10)
    assert len(path.states) == 8
    assert path.states[-1] is path.final
    assert [s.mean_pressure for s in path.states] == list(path.mean_pressure)


@pytest.mark.parametrize("index", [0, 3, 6])
def test_path_is_the_direct_solution(path, index):
    direct = solve_contact(
        HEIGHTS, SPACING, MODULUS, displacement=path.displacement[index], tolerance=1e-10
    )
    assert path.mean_pressure[index] == pytest.approx(direct.mean_pressure, rel=1e-8)
    np.testing.assert_allclose(
        path.states[index].pressure, direct.pressure, atol=1e-7 * direct.pressure.max()
    )


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(2, 20), st.integers(2, 20)),
    st.floats(1.0, 1000.0),
    st.integers(2, 6),
)
def test_path_is_the_direct_solution_on_any_surface(seed, shape, target, steps):
    heights = 0.002 * np.random.default_rng(seed).standard_normal(shape)
    path = load_path(
        heights,
        0.01,
        MODULUS,
        target_pressure=target,
        steps=steps,
        tolerance=1e-11,
        keep_states=True,
    )
    for state in path.states:
        direct = solve_contact(
            heights, 0.01, MODULUS, displacement=state.displacement, tolerance=1e-11
        )
        np.testing.assert_allclose(
            state.pressure, direct.pressure, atol=1e-7 * direct.pressure.max()
        )


@pytest.mark.parametrize("index", [1, 7])
def test_stiffness_is_the_derivative(path, index):
    # The derivative is exact where the contact set does not change; across a change it is
    # continuous, so a small central difference meets it up to the size of that change.
    step = 1e-6 * path.displacement[-1]
    around = [
        solve_contact(
            HEIGHTS,
            SPACING,
            MODULUS,
            displacement=path.displacement[index] + sign * step,
            initial_pressure=path.states[index].pressure,
            tolerance=1e-13,
        ).mean_pressure
        for sign in (-1, 1)
    ]
    assert path.stiffness[index] == pytest.approx((around[1] - around[0]) / (2 * step), rel=1e-5)


def test_stiffness_of_hertz_and_of_the_full_square():
    radius, force = 10.0, 20.0
    a = (3 * force * radius / (4 * MODULUS)) ** (1 / 3)
    n, side = 128, 3 * a
    path = load_path(
        sphere(n, side / n, radius), side / n, MODULUS, target_pressure=force / side**2, steps=2
    )
    assert path.stiffness[-1] == pytest.approx(2 * MODULUS * a / side**2, rel=0.02)
    flat = load_path(np.zeros((64, 64)), 0.85 / 64, MODULUS, target_pressure=5.0, steps=2)
    np.testing.assert_allclose(flat.stiffness, 1.14617 * MODULUS / 0.85, rtol=1e-5)


def test_one_step_and_no_states():
    path = load_path(HEIGHTS, SPACING, MODULUS, target_pressure=40.0, steps=1)
    assert path.displacement.shape == path.stiffness.shape == (1,)
    assert path.states == ()


def test_progress_is_told_every_state():
    told = []
    path = load_path(
        HEIGHTS,
        SPACING,
        MODULUS,
        target_pressure=40.0,
        steps=4,
        progress=lambda index, steps, state: told.append((index, steps, state.mean_pressure)),
    )
    assert sorted(told) == [(i, 4, p) for i, p in enumerate(path.mean_pressure)]


def test_target_beyond_the_allowed_displacement():
    reached = solve_contact(HEIGHTS, SPACING, MODULUS, displacement=0.005).mean_pressure
    with pytest.raises(UnreachableTargetError, match=r"0\.005 mm") as caught:
        load_path(
            HEIGHTS, SPACING, MODULUS, target_pressure=2 * reached, maximum_displacement=0.005
        )
    assert caught.value.mean_pressure == pytest.approx(reached, rel=1e-6)
    path = load_path(
        HEIGHTS,
        SPACING,
        MODULUS,
        target_pressure=0.99 * reached,
        maximum_displacement=0.005,
        steps=2,
    )
    assert path.displacement[-1] < 0.005


@pytest.mark.parametrize(
    "change",
    [
        {"target_pressure": 0},
        {"target_pressure": -3.0},
        {"target_pressure": np.nan},
        {"steps": 0},
        {"steps": 2.5},
        {"tolerance": -1},
        {"maximum_displacement": -1.0},
    ],
)
def test_bad_input_is_refused(change):
    with pytest.raises(InvalidContactInput):
        load_path(HEIGHTS, SPACING, MODULUS, **({"target_pressure": 1.0} | change))
