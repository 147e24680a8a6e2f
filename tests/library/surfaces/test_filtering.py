"""The S-filter keeps what is longer than its waves, up to the edges of a map."""

from numpy.testing import assert_allclose

from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.grid import axis_coordinates, make_surface


def test_s_filter_keeps_a_plane_up_to_its_edges():
    y, x = axis_coordinates(40, 2e-3), axis_coordinates(60, 1e-3)
    plane = make_surface(0.3 * y[:, None] - 0.2 * x + 1, (2e-3, 1e-3))
    assert_allclose(s_filtered(plane, 20.0), plane, rtol=1e-12)
    assert s_filtered(plane, None) is plane
