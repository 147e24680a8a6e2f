"""Places on the square: to a scan's points and back, with the shape that is asked for."""

import numpy as np
import pytest
import trimesh
from contacts import around
from gstlib.change.registration import register
from gstlib.contact import Interface
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.footprints import PatchPosition, spline_of
from gstlib.surfaces.frames import Frame, on_mesh
from gstlib.surfaces.grid import coarser, make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane
from hypothesis import given
from hypothesis import strategies as st

LENGTHS, TURNS = st.floats(-10, 10), st.floats(-360, 360)


@given(LENGTHS, LENGTHS, TURNS, LENGTHS, LENGTHS)
def test_what_a_scan_sees_lies_where_its_points_are(y, x, turn, v, u):
    place = PatchPosition(y, x, turn)
    np.testing.assert_allclose(place.seen(*place.points(v, u)), (v, u), atol=1e-12)
    np.testing.assert_allclose(place.points(*place.seen(v, u)), (v, u), atol=1e-12)


def test_a_turn_is_from_x_towards_y():
    np.testing.assert_allclose(
        PatchPosition(1.0, 2.0, 90.0).points(0.0, 0.5), (1.5, 2.0), atol=1e-12
    )
    np.testing.assert_allclose(
        PatchPosition(1.0, 2.0, 90.0).points(0.5, 0.0), (1.0, 1.5), atol=1e-12
    )


def test_a_field_lies_on_the_vertices_over_it():
    """On the side that the square looks from, in the element over the vertex; 0 beyond the face."""
    slab = trimesh.creation.box((20, 20, 3)).subdivide_to_size(1.0)
    frame = Frame(origin=(1.0, 2.0, 1.5), x_axis=(0, 1, 0), normal=(0, 0, 1))  # x up the mesh's y
    values = on_mesh(around(np.arange(64.0).reshape(8, 8), 0.5, 1.0), slab, frame)
    x, y = slab.vertices[:, 1] - 2.0, 1.0 - slab.vertices[:, 0]
    inside = (slab.vertices[:, 2] > 0) & (abs(x - 1) < 1.999) & (abs(y - 1) < 1.999)
    row, column = (((of[inside] + 1) / 0.5).astype(int) for of in (y, x))
    assert inside.sum() > 20
    np.testing.assert_array_equal(values[inside], 8 * row + column)
    outside = (slab.vertices[:, 2] < 0) | (abs(x - 1) > 2.001) | (abs(y - 1) > 2.001)
    assert (values[outside] == 0).all()


def test_coarser_elements_are_means_of_what_is_known():
    """Where the stone ends within one, it is not lost; what fills none in the end is left out."""
    block = np.array([[1.0, np.nan], [3.0, 5.0]])
    heights = np.pad(np.block([[block, 2 * block], [3 * block, 4 * block]]), (0, 1))
    found = coarser(make_surface(heights, (0.5, 0.25)), 2)
    np.testing.assert_array_equal(found, [[3.0, 6.0], [9.0, 12.0]])
    assert spacing_of(found) == (1.0, 0.5)


def test_the_coordinates_decide_the_spacing():
    """To the last digit that scans and grids have, also if the grid begins elsewhere."""
    for spacing in (0.05, 0.125, 0.001660156, 0.85 / 512):
        whole = around(np.zeros((300, 420)), spacing, 100 * spacing)
        assert spacing_of(whole) == spacing_of(whole[100:, 50:]) == (spacing, spacing)
    assert spacing_of(whole[::2, ::4]) == (2 * spacing, 4 * spacing)
    assert spacing_of(whole.coarsen(y=2, x=4).mean()) == (2 * spacing, 4 * spacing)
    for spacing in (5 / 3012, 1 / 3, 0.85 / 129):
        assert spacing_of(make_surface(np.zeros((3, 3012)), spacing)) == (spacing, spacing)


SURFACE = make_surface(np.random.default_rng(1).normal(size=(12, 16)), (0.002, 0.001))


@pytest.mark.parametrize(
    "made",
    [
        SURFACE.transpose("x", "y"),
        SURFACE[::-1],
        SURFACE[:1],
        SURFACE.drop_vars("y"),
        SURFACE.assign_coords(x=SURFACE.x**2),
        SURFACE.assign_coords(x=SURFACE.x.assign_attrs(spacing=0.002)),
    ],
)
@pytest.mark.parametrize(
    "use",
    [
        spacing_of,
        remove_plane,
        spline_of,
        lambda surface: s_filtered(surface, None),
        lambda surface: Interface(SURFACE, surface),
        lambda surface: register(SURFACE, surface, maximum_shift_mm=0.1),
    ],
)
def test_a_surface_on_odd_coordinates_is_refused(made, use):
    with pytest.raises(ValueError, match=r"coordinate|dimensions"):
        use(made)


def test_a_surface_is_made_of_another_as_its_coordinates_say():
    np.testing.assert_array_equal(make_surface(SURFACE.T, (0.002, 0.001)), SURFACE)
    with pytest.raises(ValueError, match="spacing"):
        make_surface(SURFACE[::2], (0.002, 0.001))


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, (1.0, -1.0)])
def test_what_is_no_surface_is_refused(spacing):
    with pytest.raises(ValueError, match="spacing"):
        make_surface(np.zeros((2, 2)), spacing)
    with pytest.raises(ValueError, match="dimensions"):
        make_surface(np.zeros(4), 1.0)
