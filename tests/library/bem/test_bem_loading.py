"""Load paths: equal steps of displacement down from a target, and the stiffness."""

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from gstlib.bem import ContactInputError, load_path, solve_contact
from hypothesis import given, settings
from hypothesis import strategies as st

HEIGHTS = self_affine(80, seed=2)
SURFACE = HEIGHTS, 0.85 / 80, MODULUS


@pytest.fixture(scope="module")
def path():
    return load_path(*SURFACE, target_pressure=40.0, steps=8, tolerance=1e-10, keep_states=True)


def test_steps_are_equal_in_displacement_and_end_at_the_target(path):
    np.testing.assert_allclose(
        path.displacement, path.displacement[-1] * np.arange(1, 9) / 8, rtol=1e-14
    )
    assert np.all(np.diff(path.mean_pressure) > 0)
    assert np.all(np.diff(path.contact_fraction) >= 0)
    assert np.all(path.residual <= 1e-10)
    assert len(path.states) == 8
    assert path.states[-1] is path.final
    assert [s.mean_pressure for s in path.states] == list(path.mean_pressure)
    assert path.mean_pressure[-1] == pytest.approx(40.0, rel=1e-13)
    assert path.final.displacement == path.displacement[-1]
    direct = solve_contact(*SURFACE, mean_pressure=40.0, tolerance=1e-10)
    np.testing.assert_allclose(path.final.pressure, direct.pressure, atol=1e-12 * 40)


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(2, 20), st.integers(2, 20)),
    st.floats(1.0, 1000.0),
    st.integers(2, 6),
)
def test_path_is_the_direct_solution_on_any_surface(seed, shape, target, steps):
    surface = 0.002 * np.random.default_rng(seed).standard_normal(shape), 0.01, MODULUS
    path = load_path(
        *surface, target_pressure=target, steps=steps, tolerance=1e-11, keep_states=True
    )
    for state in path.states:
        direct = solve_contact(*surface, displacement=state.displacement, tolerance=1e-11)
        np.testing.assert_allclose(
            state.pressure, direct.pressure, atol=1e-7 * direct.pressure.max()
        )


@pytest.mark.parametrize("index", [1, 7])
def test_stiffness_is_the_derivative(path, index):
    # The derivative is exact where the contact set does not change; across a change it is
    # continuous, so a small central difference meets it up to the size of that change.
    step = 1e-6 * path.displacement[-1]
    below, above = (
        solve_contact(
            *SURFACE,
            displacement=path.displacement[index] + change,
            initial_pressure=path.states[index].pressure,
            tolerance=1e-13,
        ).mean_pressure
        for change in (-step, step)
    )
    assert path.stiffness[index] == pytest.approx((above - below) / (2 * step), rel=1e-5)


def test_states_that_are_not_kept_are_solved_as_tightly_as_their_curve_needs(path):
    curve = load_path(*SURFACE, target_pressure=40.0, steps=8, tolerance=1e-10)
    assert curve.states == ()
    assert curve.residual[-1] <= 1e-10
    assert np.all(curve.residual <= 1e-6)
    assert curve.iterations[:-1].sum() < 0.8 * path.iterations[:-1].sum()
    # Without the start along the tangent: 102.
    assert curve.convolutions.sum() <= 80
    np.testing.assert_array_equal(curve.displacement, path.displacement)
    np.testing.assert_array_equal(curve.contact_fraction, path.contact_fraction)
    np.testing.assert_allclose(curve.mean_pressure, path.mean_pressure, rtol=1e-6)
    np.testing.assert_allclose(curve.stiffness, path.stiffness, rtol=1e-5)


def test_without_pressure_nothing_touches():
    path = load_path(*SURFACE, target_pressure=0, steps=3, keep_states=True)
    for values in (path.displacement, path.mean_pressure, path.contact_fraction, path.stiffness):
        assert values.tolist() == [0, 0, 0]
    assert path.convolutions.sum() == path.residual.sum() == 0
    assert len(path.states) == 3
    np.testing.assert_array_equal(path.final.gap, HEIGHTS.max() - HEIGHTS)


@pytest.mark.parametrize(
    "change",
    [{"target_pressure": -3.0}, {"target_pressure": np.nan}, {"steps": 0}, {"tolerance": -1}],
)
def test_bad_input_is_refused(change):
    with pytest.raises(ContactInputError):
        load_path(*SURFACE, **({"target_pressure": 1.0} | change))
