"""Planes: exact on planes, least squares elsewhere, and no plane is left."""

import math

import numpy as np
import pytest
from gstlib.errors import InputError
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import Plane, remove_plane
from hypothesis import given
from hypothesis import strategies as st

slopes = st.floats(-0.5, 0.5)
shapes = st.tuples(st.integers(2, 12), st.integers(2, 12))


def plane_surface(shape, offset, slope_y, slope_x, spacing=(0.02, 0.05)):
    surface = make_surface(np.zeros(shape), spacing)
    return surface.copy(data=Plane(offset, slope_y, slope_x).heights(surface))


@given(shapes, st.floats(-100, 100), slopes, slopes)
def test_exact_on_planes(shape, offset, slope_y, slope_x):
    level, plane = remove_plane(plane_surface(shape, offset, slope_y, slope_x))
    found = plane.offset, plane.slope_y, plane.slope_x
    assert found == pytest.approx((offset, slope_y, slope_x), abs=1e-10)
    np.testing.assert_allclose(level, 0.0, atol=1e-10)


@given(st.integers(0, 1000))
def test_agrees_with_a_general_least_squares_solver(seed):
    rng = np.random.default_rng(seed)
    surface = make_surface(rng.normal(size=(6, 8)), (0.1, 0.3))
    measured = rng.uniform(size=(6, 8)) < 0.6
    measured[:2, :2] = True
    plane = remove_plane(surface.where(measured))[1]
    y, x = np.meshgrid(surface.y - 0.3, surface.x - 1.2, indexing="ij")
    matrix = np.stack([np.ones_like(x), y, x], axis=-1)
    expected = np.linalg.lstsq(matrix[measured], surface.values[measured])[0]
    np.testing.assert_allclose((plane.offset, plane.slope_y, plane.slope_x), expected, atol=1e-9)


def test_too_few_points():
    surface = make_surface(np.full((4, 4), math.nan), 1.0, file="a.plu")
    surface[1, :] = 1.0
    with pytest.raises(InputError, match=r"a\.plu: a plane cannot be fitted to 4"):
        remove_plane(surface)
