"""The composite surface: scans laid on the mesh, and detail like theirs between."""

from dataclasses import astuple

import numpy as np
import pytest
import xarray as xr
from contacts import laid, mesh_face, pressed, written
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.coupling.embedding import place_patch
from gstlib.errors import InputError
from gstlib.macroscale.composite import (
    compose,
    compose_surface,
    draw_mesh_errors,
    plane_under,
    refined,
)
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.footprints import PatchPosition, places_of, spline_of
from gstlib.surfaces.grid import axis_coordinates, make_surface
from gstlib.surfaces.leveling import Plane, remove_plane
from gstlib.validation.single_scale import drawn_surfaces, solve_reference

NO_DETAIL = xr.DataArray(
    np.zeros(2), dims="frequency", coords={"frequency": [1.0, 2.0]}
)
SIDE, COUNT, PATCH, POINTS = 4.0, 40, 0.8, 64
PLACES = written(
    """
    patch, x_mm, y_mm, rotation_deg
    a,     1.0,  1.2,  0
    b,     2.7,  2.5,  20
    """
)


def waves(y, x):
    """A smooth stone, mm."""
    return (
        0.02 * np.sin(2 * np.pi * x / 3.1 + 0.4) * np.cos(2 * np.pi * y / 2.7)
        + 0.01 * x
    )


def mesh_surface(error=1e-4):
    """The stone as the mesh shows it, with vertices that err."""
    along = axis_coordinates(COUNT, SIDE / COUNT)
    height = make_surface(waves(along[:, None], along), SIDE / COUNT)
    return mesh_face(height, error, 400, seed=1)


def scans(detail=1e-3):
    """Levelled scans of the stone, with detail that the mesh lacks."""
    noise = np.random.default_rng(2).standard_normal((2, POINTS, POINTS))
    levels = {}
    for (patch, place), each in zip(places_of(PLACES).items(), noise, strict=True):
        rough = s_filtered(make_surface(each, PATCH / POINTS), 60.0)
        level, _ = laid(waves, place, PATCH, POINTS)
        level, _ = remove_plane(level + rough * detail / rough.std())
        levels[patch] = level.to_dataset(name="height")
    return levels


def composed(detail=1e-3, *, error=1e-4, placement_um=0.0, levels=None):
    """The composite of scans on a face."""
    return compose_surface(
        mesh_surface(error),
        PLACES,
        levels or scans(detail),
        patch_mm=PATCH,
        s_filter_um=None,
        placement_um=placement_um,
        seed=1,
    )


def test_a_scan_gets_back_the_plane_that_levelling_took():
    """Turned or not: the slopes along the scan's own axes, and the mean height."""
    spline = spline_of(mesh_surface().height)
    for place in places_of(PLACES).values():
        _, adopted = laid(waves, place, PATCH, POINTS)
        plane = plane_under(spline, place, PATCH)
        assert_allclose(astuple(plane), astuple(adopted), atol=1e-4)


def test_the_composite_is_the_scan_inside_its_outline_and_the_mesh_outside():
    spline = spline_of(mesh_surface().height)
    place = PatchPosition(2.0, 1.5, 30.0)
    bump = np.zeros((POINTS, POINTS))
    bump[40, 20] = 1.0  # v > 0, u < 0
    grid = refined(mesh_surface().height, 8)
    scan = place, Plane(0.5, 0.1, -0.2), bump
    heights = compose(spline, [scan], PATCH, grid, NO_DETAIL, 0).values
    along = grid.x.values
    v, u = place.seen(along[:, None], along)
    inside = np.maximum(abs(u), abs(v)) < PATCH / 2
    assert_allclose(heights[~inside], spline(along, along)[~inside])
    above = heights - (0.5 + 0.1 * v - 0.2 * u)
    raised = inside & (above > 1e-9)
    assert_allclose(above[inside & ~raised], 0, atol=1e-9)
    # in points of the scan
    at = (np.array([v[raised], u[raised]]) + PATCH / 2) / PATCH * POINTS
    assert abs(at - [[40.5], [20.5]]).max() < 1


def test_a_scan_is_not_stretched_over_its_patch():
    wide = {patch: scan.assign_coords(x=2 * scan.x) for patch, scan in scans().items()}
    with pytest.raises(InputError, match=r"patch a: the map is 1\.6 × 0\.8 mm"):
        composed(levels=wide)
    composite = composed()
    contact = pressed(composite.height, mean_pressure=1.0)
    with pytest.raises(InputError, match=r"patch a: the map is 1\.6 × 0\.8 mm"):
        place_patch(wide["a"].height, None, composite, contact, "a")
    with pytest.raises(InputError, match=r"square: the map is 1\.6 × 0\.8 mm"):
        solve_reference(wide["a"].height, contact)


def test_the_mesh_errors_have_the_size_of_the_left_out_errors():
    face = mesh_surface(error=2e-3)
    drawn = draw_mesh_errors(face, face.height, 50, np.random.default_rng(0))
    # each is the mean of about three vertices' errors
    assert 0.5 * 2e-3 < drawn.std() < 1.0 * 2e-3
    assert abs(drawn.mean()) < 2e-4


def test_a_plane_that_the_mesh_does_not_know_is_left_level():
    """It is known if its tilt exceeds the errors of both slopes together."""
    unsure = composed(error=0.05)
    ratio = float((unsure.tilt_mrad / unsure.tilt_error_mrad)[0])
    for tilt_over_error, is_known in ((1.3, False), (1.6, True)):
        composite = composed(error=0.05 * ratio / tilt_over_error)
        first = composite.isel(patch=0)
        now = float(first.tilt_mrad / first.tilt_error_mrad)
        assert now == pytest.approx(tilt_over_error, abs=0.05)
        assert bool(first.known) == is_known
        laid = (composite.slope_x != 0) & (composite.slope_y != 0)
        assert_array_equal(laid, composite.known)


def test_the_error_of_a_plane_is_that_of_mesh_place_and_unseen_waves():
    """The mesh's is above; of a place on a curved stone, and of waves that the scans show."""
    still, smooth, rough, moved, further = (
        composed(detail, error=0.0, placement_um=placement_um).tilt_error_mrad
        for detail, placement_um in zip(
            (1e-6, 1e-3, 1e-2, 1e-6, 1e-6), (0, 0, 0, 20, 40), strict=True
        )
    )
    assert_allclose(rough, 10 * smooth, rtol=0.1)
    assert (moved > 5 * still).all()
    assert_allclose(further, 2 * moved, rtol=0.1)


def test_at_the_scans_resolution_each_draw_has_other_detail_and_the_same_scans():
    levels, composite = scans(), composed()
    surfaces = mesh_surface(), composite, levels
    first, other, filtered, _ = (
        heights.values
        for s_filter_um in (None, 60.0)
        for heights in drawn_surfaces(
            *surfaces, draws=2, s_filter_um=s_filter_um, seed=1
        )
    )
    at = slice(64, 128), slice(48, 112)  # patch a, not turned, about x 1 and y 1.2
    assert_array_equal(first[at], other[at])
    assert (first - other)[:, 300:].std() > 5e-4
    a, height = composite.isel(patch=0), levels["a"].height
    y, x = height.y - PATCH / 2, height.x - PATCH / 2
    plane = a.offset + a.slope_y * y + a.slope_x * x
    assert_allclose(first[at] - plane, height, atol=1e-9)
    assert_allclose(filtered[at] - plane, s_filtered(height, 60.0), atol=1e-9)
