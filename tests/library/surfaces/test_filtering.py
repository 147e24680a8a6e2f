"""The S-filter: which waves pass, and what happens at the edges."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.grid import axis_coordinates, make_surface


@pytest.mark.parametrize("axis", [0, 1])
def test_s_filter_halves_a_wave_as_long_as_its_nesting_index(axis):
    """Along either axis, of which the points lie closer along this one."""
    wave = np.cos(2 * np.pi * axis_coordinates(512, 1e-3) / 0.032)
    heights, spacing = np.tile(wave, (64, 1)), (3e-3, 1e-3)
    if axis == 0:
        heights, spacing = heights.T, spacing[::-1]
    filtered = s_filtered(make_surface(heights, spacing), 32.0).values
    middle = np.moveaxis(filtered, axis, 1)[32, 128:384]
    assert_allclose(middle, 0.5 * wave[128:384], atol=2e-3)


def test_s_filter_keeps_a_plane_up_to_its_edges():
    y, x = axis_coordinates(40, 2e-3), axis_coordinates(60, 1e-3)
    plane = make_surface(0.3 * y[:, None] - 0.2 * x + 1, (2e-3, 1e-3))
    assert_allclose(s_filtered(plane, 20.0), plane, rtol=1e-12)
    assert s_filtered(plane, None) is plane
