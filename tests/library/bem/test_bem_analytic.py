"""The solver against closed forms, with rates of convergence."""

import numpy as np
import pytest
from bem_reference import MODULUS, centred

from gstlib.bem import load_path, solve_contact
from gstlib.bem.closed_forms import SQUARE_PUNCH_STIFFNESS, Ellipsoid


def test_an_ellipsoid_converges_to_hertzs_pressure_and_displacement():
    exact = Ellipsoid(20.0, 12.0, 4.0, MODULUS)
    errors = []
    for n in (48, 192):
        spacing = 2.6 * max(exact.semi_axes) / n
        y, x = centred(n, spacing)
        heights = -(x**2) / 24 - y**2 / 8
        mean = 20.0 / (n * spacing) ** 2
        state = solve_contact(
            heights, spacing, MODULUS, mean_pressure=mean, tolerance=1e-8
        )
        pressure = np.sqrt(((state.pressure - exact.pressure(x, y)) ** 2).mean())
        touch = state.displacement - heights.max()
        errors.append(
            (pressure / exact.peak_pressure, abs(touch / exact.displacement - 1))
        )
    assert np.all(np.less(errors[1], (2e-3, 2e-4)))
    rates = np.log2(np.divide(*errors)) / 2
    assert np.all(rates > (0.9, 1.2))


def test_square_punch_extrapolates_to_the_constant():
    errors = []
    for n in (32, 64, 128):
        path = load_path(np.zeros((n, n)), 1 / n, MODULUS, target_pressure=1.0, steps=1)
        errors.append(SQUARE_PUNCH_STIFFNESS - path.stiffness[0] / MODULUS)
    assert 2 * errors[2] - errors[1] == pytest.approx(0, abs=1e-4)
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx([2, 2], abs=0.07)
