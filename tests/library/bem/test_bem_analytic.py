"""The solver against closed forms, with rates of convergence."""

import numpy as np
import pytest
from bem_reference import MODULUS, centred, sphere

from gstlib.bem import load_path, solve_contact
from gstlib.bem.closed_forms import Sphere


def test_a_sphere_converges_to_hertzs_pressure_and_displacement():
    exact = Sphere(20.0, 10.0, MODULUS)
    errors = []
    for n in (48, 192):
        spacing = 2.6 * exact.contact_radius / n
        heights = sphere(n, spacing, exact.radius)
        mean = exact.force / (n * spacing) ** 2
        state = solve_contact(
            heights, spacing, MODULUS, mean_pressure=mean, tolerance=1e-8
        )
        misfit = state.pressure - exact.pressure(*centred(n, spacing))
        touch = state.displacement - heights.max()
        errors.append(
            (misfit.std() / exact.peak_pressure, abs(touch / exact.displacement - 1))
        )
    assert np.all(np.less(errors[1], (2e-3, 2e-4)))
    rates = np.log2(np.divide(*errors)) / 2
    assert np.all(rates > (0.9, 1.2))


def test_square_punch_extrapolates_to_the_constant():
    """1.1523 E* times the side and the displacement, from below."""
    errors = []
    for n in (32, 64, 128):
        path = load_path(np.zeros((n, n)), 1 / n, MODULUS, target_pressure=1.0, steps=1)
        errors.append(1.1523 - path.stiffness[0] / MODULUS)
    assert 2 * errors[2] - errors[1] == pytest.approx(0, abs=1e-4)
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx([2, 2], abs=0.07)
