"""Planes: least squares, and no plane is left."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gstlib.errors import InputError
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane


def test_a_plane_is_that_of_least_squares_and_points_in_line_have_none():
    rng = np.random.default_rng(1)
    surface = make_surface(rng.normal(size=(6, 8)), (0.1, 0.3), file="a.plu")
    surface = surface.where(rng.uniform(size=(6, 8)) < 0.6)
    level, _ = remove_plane(surface)
    y, x = np.meshgrid(surface.y, surface.x, indexing="ij")
    columns = np.stack([np.ones_like(x), y, x], axis=-1)
    measured = np.isfinite(surface.values)
    expected = np.linalg.lstsq(columns[measured], surface.values[measured])[0]
    assert_allclose(level, surface - columns @ expected, atol=1e-9)
    surface[1:] = np.nan
    with pytest.raises(InputError, match=r"a\.plu: a plane cannot be fitted to"):
        remove_plane(surface)
