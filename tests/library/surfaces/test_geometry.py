"""Places on the square: to a scan's points and back, with the shape that is asked for."""

from contextlib import nullcontext

import numpy as np
import pytest
import trimesh
from contacts import around
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.change.registration import register
from gstlib.contact import Interface
from gstlib.errors import InputError
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.footprints import PatchPosition, check_size
from gstlib.surfaces.frames import Frame, on_mesh
from gstlib.surfaces.grid import coarser, make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane


def test_a_scan_sees_its_points_where_they_lie():
    """It is turned from x towards y."""
    quarter, place = PatchPosition(1.0, 2.0, 90.0), PatchPosition(-3.0, 7.0, 35.0)
    assert_allclose(quarter.points(0.5, 0.0), (1.0, 1.5), atol=1e-12)
    assert_allclose(quarter.points(0.0, 0.5), (1.5, 2.0), atol=1e-12)
    assert_allclose(place.seen(*place.points(0.3, -2.0)), (0.3, -2.0), atol=1e-12)


@pytest.mark.parametrize(
    ("points", "spacing", "fits"),
    [
        (256, 0.00332, True),
        (17, 0.0519, True),  # the nearest number of elements
        (127, 0.85 * 0.991 / 127.9, True),  # of a scan made coarser
        (100, 0.00858, True),
        (100, 0.0088, False),
        (256, (0.00332, 0.00664), False),
    ],
)
def test_a_map_is_as_large_as_its_place(points, spacing, fits):
    surface = make_surface(np.zeros((points, points)), spacing)
    with nullcontext() if fits else pytest.raises(InputError, match="a: the map is"):
        check_size(surface, 0.85, "a")


def test_a_field_lies_on_the_vertices_over_it():
    """On the side that the square looks from, in the element over the vertex; 0 beyond the face."""
    slab = trimesh.creation.box((20, 20, 3)).subdivide_to_size(1.0)
    # its x runs up the mesh's y
    frame = Frame(origin=(1.0, 2.0, 1.5), x_axis=(0, 1, 0), normal=(0, 0, 1))
    field = around(np.arange(64.0).reshape(8, 8), 0.5, 1.0)
    values = on_mesh(field, slab, frame)
    x, y, z = frame.to_frame(slab.vertices).T
    distance = np.maximum(abs(x - 1), abs(y - 1))
    is_over = (z > -1) & (distance < 1.999)
    assert is_over.sum() > 20
    assert_array_equal(
        values[is_over], (8 * ((y + 1) // 0.5) + (x + 1) // 0.5)[is_over]
    )
    assert not values[(z < -1) | (distance > 2.001)].any()


def test_coarser_elements_are_means_of_measured_ones():
    """Where the stone ends within one, it is not lost; an incomplete one at the end is left out."""
    block = np.array([[1.0, np.nan], [3.0, 5.0]])
    heights = np.pad(np.kron([[1, 2], [3, 4]], block), (0, 1))
    surface = coarser(make_surface(heights, (0.5, 0.25)), 2)
    assert_array_equal(surface, [[3.0, 6.0], [9.0, 12.0]])
    assert spacing_of(surface) == (1.0, 0.5)


@pytest.mark.parametrize("spacing", [0.05, 0.001660156, 0.85 / 512])
def test_the_coordinates_decide_the_spacing(spacing):
    """To the last digit that scans and grids have, also if the grid begins elsewhere."""
    whole = around(np.zeros((300, 420)), spacing, 100 * spacing)
    assert spacing_of(whole) == spacing_of(whole[100:, 50:]) == (spacing, spacing)
    assert spacing_of(whole[::2, ::4]) == (2 * spacing, 4 * spacing)
    assert spacing_of(whole.coarsen(y=2, x=4).mean()) == (2 * spacing, 4 * spacing)


SURFACE = make_surface(np.random.default_rng(1).normal(size=(12, 16)), (0.002, 0.001))


@pytest.mark.parametrize(
    "odd",
    [
        SURFACE.transpose("x", "y"),
        SURFACE[::-1],
        SURFACE.drop_vars("y"),
        SURFACE.assign_coords(x=SURFACE.x**2),
        SURFACE.assign_coords(x=SURFACE.x.assign_attrs(spacing=0.002)),
    ],
)
def test_a_surface_on_odd_coordinates_is_refused(odd):
    with pytest.raises(ValueError, match=r"coordinate|dimensions"):
        spacing_of(odd)


@pytest.mark.parametrize("unit", ["m", "µm"])
@pytest.mark.parametrize("used", [prepare_scan, Interface.on_flat, remove_plane])
def test_heights_in_another_unit_are_refused(used, unit):
    with pytest.raises(ValueError, match=f"heights are in {unit}: convert them to mm"):
        used(SURFACE.assign_attrs(units=unit))


def test_masked_heights_are_unmeasured():
    masked = np.ma.masked_greater(np.arange(6).reshape(2, 3), 4)
    assert_array_equal(make_surface(masked, 1.0), [[0, 1, 2], [3, 4, np.nan]])


def test_surfaces_of_other_spacings_are_not_compared():
    assert_array_equal(make_surface(SURFACE.T, (0.002, 0.001)), SURFACE)
    with pytest.raises(ValueError, match="spacing"):
        make_surface(SURFACE[::2], (0.002, 0.001))
    with pytest.raises(InputError, match="spacing"):
        register(SURFACE, SURFACE[::2], maximum_shift_mm=0.1)


@pytest.mark.parametrize(
    ("shape", "spacing", "match"),
    [
        ((2, 2), (1.0, -1.0), "spacing"),
        ((2, 2), np.nan, "spacing"),
        ((2, 2), (1.0, 1.0, 1.0), "one number or two"),
        (4, 1.0, "dimensions"),
    ],
)
def test_an_array_that_is_no_surface_is_refused(shape, spacing, match):
    with pytest.raises(ValueError, match=match):
        make_surface(np.zeros(shape), spacing)
