"""Load paths: equal steps of displacement down from a target, and the stiffness."""

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from numpy.testing import assert_allclose

from gstlib.bem import ContactInputError, load_path, solve_contact

HEIGHTS = self_affine(80, seed=2)
SURFACE = HEIGHTS, 0.85 / 80, MODULUS


@pytest.fixture(scope="module")
def path():
    return load_path(
        *SURFACE, target_pressure=40.0, steps=8, tolerance=1e-10, keep_states=True
    )


def test_steps_are_equal_in_displacement_and_end_at_the_target(path):
    levels = path.displacement[-1] * np.arange(1, 9) / 8
    assert_allclose(path.displacement, levels, rtol=1e-14)
    assert np.all(path.residual <= 1e-10)
    assert path.states[-1] is path.final
    assert path.mean_pressure[-1] == pytest.approx(40.0, rel=1e-13)
    level = path.displacement[3]
    direct = solve_contact(*SURFACE, displacement=level, tolerance=1e-10).pressure
    assert_allclose(path.states[3].pressure, direct, atol=1e-7 * direct.max())


@pytest.mark.parametrize("periodic", [False, True])
def test_stiffness_is_the_derivative(periodic):
    options = {"steps": 4, "periodic": periodic, "tolerance": 1e-10}
    path = load_path(*SURFACE, target_pressure=40.0, **options)
    options = {"periodic": periodic, "tolerance": 1e-13}
    step = 1e-6 * path.displacement[-1]
    for level, stiffness in zip(path.displacement, path.stiffness, strict=True):
        below, above = (
            solve_contact(*SURFACE, displacement=level + off, **options).mean_pressure
            for off in (-step, step)
        )
        assert stiffness == pytest.approx((above - below) / (2 * step), rel=1e-5)


def test_states_that_are_not_kept_are_solved_as_tightly_as_their_curve_needs(path):
    curve = load_path(*SURFACE, target_pressure=40.0, steps=8, tolerance=1e-10)
    assert curve.residual[-1] <= 1e-10
    assert np.all(curve.residual <= 1e-6)
    # Without the start along the tangent: 100.
    assert curve.convolutions.sum() <= 85
    assert_allclose(curve.mean_pressure, path.mean_pressure, rtol=1e-6)
    assert_allclose(curve.stiffness, path.stiffness, rtol=1e-5)


@pytest.mark.parametrize("change", [{"target_pressure": -3.0}, {"steps": 0}])
def test_bad_input_is_refused(change):
    with pytest.raises(ContactInputError):
        load_path(*SURFACE, **({"target_pressure": 1.0} | change))
