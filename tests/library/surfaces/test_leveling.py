"""Planes: least squares, and no plane is left."""

import math

import numpy as np
import pytest
from gstlib.errors import InputError
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from hypothesis import given
from hypothesis import strategies as st


@given(st.integers(0, 1000))
def test_agrees_with_a_general_least_squares_solver(seed):
    rng = np.random.default_rng(seed)
    surface = make_surface(rng.normal(size=(6, 8)), (0.1, 0.3))
    measured = rng.uniform(size=(6, 8)) < 0.6
    measured[:2, :2] = True
    level, plane = remove_plane(surface.where(measured))
    y, x = np.meshgrid(surface.y - 0.3, surface.x - 1.2, indexing="ij")
    matrix = np.stack([np.ones_like(x), y, x], axis=-1)
    expected = np.linalg.lstsq(matrix[measured], surface.values[measured])[0]
    np.testing.assert_allclose((plane.offset, plane.slope_y, plane.slope_x), expected, atol=1e-9)
    left = surface.where(measured) - matrix @ expected
    np.testing.assert_allclose(level, left, atol=1e-9)


def test_too_few_points():
    surface = make_surface(np.full((4, 4), math.nan), 1.0, file="a.plu")
    surface[1, :] = 1.0
    with pytest.raises(InputError, match=r"a\.plu: a plane cannot be fitted to 4"):
        remove_plane(surface)
