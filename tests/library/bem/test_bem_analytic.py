"""The solver against closed forms, with rates of convergence; closed forms against each other."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS
from gstlib.bem import load_path, solve_contact
from gstlib.bem.closed_forms import SQUARE_PUNCH_STIFFNESS, Cone, Ellipsoid


def centred(n, spacing):
    at = (np.arange(n) - (n - 1) / 2) * spacing
    return np.meshgrid(at, at)


def solved(heights, spacing, force, **options):
    mean = force / (heights.size * spacing**2)
    return solve_contact(heights, spacing, MODULUS, mean_pressure=mean, tolerance=1e-8, **options)


ELLIPSOID = Ellipsoid(20.0, 12.0, 4.0, MODULUS)
CONE = Cone(20.0, 1.4, MODULUS)


@pytest.mark.parametrize(
    ("exact", "height", "grids", "size", "scale", "bounds", "rates"),
    [
        (
            ELLIPSOID,
            lambda x, y: -(x**2) / 24 - y**2 / 8,
            (48, 96, 192),
            max(ELLIPSOID.semi_axes),
            ELLIPSOID.peak_pressure,
            (2e-3, 2e-4),
            (0.9, 1.2),
        ),
        (
            CONE,
            lambda x, y: -np.hypot(x, y) / math.tan(1.4),
            (33, 65, 129),  # odd: the tip lies on an element's centre
            CONE.contact_radius,
            MODULUS / math.tan(1.4),
            (5e-3, 4e-3),
            (0.8, 0.8),
        ),
    ],
    ids=["ellipsoid", "cone"],
)
def test_smooth_bodies_converge(exact, height, grids, size, scale, bounds, rates):
    errors = []
    for n in grids:
        spacing = 2.6 * size / n
        x, y = centred(n, spacing)
        state = solved(height(x, y), spacing, 20.0)
        # At the cone's tip the pressure is infinite.
        away = np.hypot(x, y) > 0.2 * size * (exact is CONE)
        difference = (state.pressure - exact.pressure(x, y))[away]
        touch = state.displacement - height(x, y).max()
        errors.append(
            (np.sqrt((difference**2).mean()) / scale, abs(touch / exact.displacement - 1))
        )
    errors = np.array(errors)
    assert np.all(errors[-1] < bounds)
    assert np.all(np.log2(errors[0] / errors[-1]) / 2 > rates)


def test_square_punch_extrapolates_to_the_constant():
    found = []
    for n in (32, 64, 128):
        path = load_path(np.zeros((n, n)), 1 / n, MODULUS, target_pressure=1.0, steps=1)
        found.append(path.stiffness[0] / MODULUS)
    errors = SQUARE_PUNCH_STIFFNESS - np.array(found)
    assert 2 * found[2] - found[1] == pytest.approx(SQUARE_PUNCH_STIFFNESS, abs=1e-4)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([1, 1], abs=0.05)
