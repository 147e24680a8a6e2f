"""Planes: least squares, and no plane is left."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gstlib.errors import InputError
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_a_general_least_squares_solver(seed):
    rng = np.random.default_rng(seed)
    surface = make_surface(rng.normal(size=(6, 8)), (0.1, 0.3))
    measured = rng.uniform(size=(6, 8)) < 0.6
    level, plane = remove_plane(surface.where(measured))
    y, x = np.meshgrid(surface.y - 0.3, surface.x - 1.2, indexing="ij")
    columns = np.stack([np.ones_like(x), y, x], axis=-1)
    expected = np.linalg.lstsq(columns[measured], surface.values[measured])[0]
    assert_allclose((plane.offset, plane.slope_y, plane.slope_x), expected, atol=1e-9)
    left = surface.where(measured) - columns @ expected
    assert_allclose(level, left, atol=1e-9)


def test_points_in_line_have_no_plane():
    surface = make_surface(np.full((4, 4), np.nan), 1.0, file="a.plu")
    surface[1, :] = 1.0
    with pytest.raises(InputError, match=r"a\.plu: a plane cannot be fitted to 4"):
        remove_plane(surface)
