"""The composite surface: scans laid on the mesh, and detail like theirs between."""

from dataclasses import astuple

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import laid, mesh_face
from gstlib.macroscale.composite import (
    compose,
    compose_grid,
    compose_surface,
    draw_mesh_errors,
    plane_under,
    refined,
)
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.footprints import PatchPosition, places_of, spline_of
from gstlib.surfaces.grid import axis_coordinates, make_surface
from gstlib.surfaces.leveling import Plane
from gstlib.validation.single_scale import composite_heights

NO_DETAIL = xr.DataArray(np.zeros(2), dims="frequency", coords={"frequency": [1.0, 2.0]})
SIDE, COUNT, PATCH, POINTS = 4.0, 40, 0.8, 64
PLACES = pd.DataFrame(
    {"patch": ["a", "b"], "x_mm": [1.0, 2.7], "y_mm": [1.2, 2.5], "rotation_deg": [0.0, 20.0]}
)


def waves(y, x):
    """A smooth stone, mm."""
    return 0.02 * np.sin(2 * np.pi * x / 3.1 + 0.4) * np.cos(2 * np.pi * y / 2.7) + 0.01 * x


def mesh_surface(error: float = 1e-4) -> xr.Dataset:
    """The stone as the mesh shows it, with vertices that err."""
    at = axis_coordinates(COUNT, SIDE / COUNT)
    return mesh_face(make_surface(waves(at[:, None], at), SIDE / COUNT), error, 400, seed=1)


def scans(detail: float = 1e-3) -> dict[str, xr.Dataset]:
    """Levelled scans of the stone, with detail that the mesh lacks."""
    generator, found = np.random.default_rng(2), {}
    for patch, place in places_of(PLACES).items():
        noise = make_surface(generator.standard_normal((POINTS, POINTS)), PATCH / POINTS)
        rough = detail * s_filtered(noise, 60.0).values / s_filtered(noise, 60.0).values.std()
        level, _ = laid(lambda y, x, rough=rough: waves(y, x) + rough, place, PATCH, POINTS)
        found[patch] = level.to_dataset(name="height")
    return found


def composed(of=None, *, error=1e-4, seed=1, placement_um=10.0) -> xr.Dataset:
    settings = {"patch_mm": PATCH, "s_filter_um": None, "placement_um": placement_um, "seed": seed}
    return compose_surface(mesh_surface(error), PLACES, of or scans(), **settings)


def test_a_scan_gets_back_the_plane_that_levelling_took():
    """Turned or not: the slopes along the scan's own axes, and the mean height."""
    spline = spline_of(mesh_surface().height)
    for place in places_of(PLACES).values():
        _, plane = laid(waves, place, PATCH, POINTS)
        found = plane_under(spline, place, PATCH)
        np.testing.assert_allclose(astuple(found), astuple(plane), atol=1e-4)


def test_the_composite_is_the_scan_inside_its_outline_and_the_mesh_outside():
    spline = spline_of(mesh_surface().height)
    place = PatchPosition(2.0, 1.5, 30.0)
    bump = np.zeros((POINTS, POINTS))
    bump[40, 20] = 1.0  # v > 0, u < 0
    grid = refined(mesh_surface().height, 8)
    laid = [(place, Plane(0.5, 0.1, -0.2), bump)]
    found = compose(spline, laid, PATCH, grid, NO_DETAIL, 0).values
    at = grid.x.values
    v, u = place.seen(at[:, None], at)
    inside = (abs(u) < PATCH / 2) & (abs(v) < PATCH / 2)
    np.testing.assert_allclose(found[~inside], spline(at, at)[~inside])
    flat = inside & (found < 0.5 + 0.1 * v - 0.2 * u + 1e-9)
    np.testing.assert_allclose(found[flat], (0.5 + 0.1 * v - 0.2 * u)[flat], atol=1e-9)
    raised = inside & ~flat
    step = PATCH / POINTS
    assert raised.any()
    assert abs(v[raised] - (40.5 * step - PATCH / 2)).max() < step
    assert abs(u[raised] - (20.5 * step - PATCH / 2)).max() < step


def test_where_outlines_overlap_their_mean_counts():
    spline = spline_of(mesh_surface().height)
    flat = np.zeros((POINTS, POINTS))
    both = [(PatchPosition(2.0, x, 0.0), Plane(h, 0, 0), flat) for x, h in ((1.5, 1.0), (1.9, 3.0))]
    found = compose(spline, both, PATCH, mesh_surface().height, NO_DETAIL, 0)
    row = found.values[COUNT // 2]
    assert set(np.round(row[(row > 0.5)], 9)) == {1.0, 2.0, 3.0}


def test_the_composite_on_the_grid_is_the_mean_over_each_element():
    height = mesh_surface().height[:, :20]
    flat = spline_of(height)(*(axis_coordinates(4 * n, SIDE / COUNT / 4) for n in height.shape))
    found = compose_grid(height, [], PATCH, NO_DETAIL, 0)
    np.testing.assert_allclose(found[7, 12], flat[28:32, 48:52].mean())


def test_detail_between_the_scans_has_their_spectrum():
    found = composed()
    fine, spline = refined(mesh_surface().height, 4), spline_of(mesh_surface().height)
    smooth = spline(fine.y, fine.x)
    detail = (compose(spline, [], PATCH, fine, found.density, 3) - smooth).values
    # 1 µm of detail; what lies beyond the fine grid's Nyquist frequency is left out
    assert detail.std() == pytest.approx(1e-3, rel=0.25)
    again = (compose(spline, [], PATCH, fine, found.density, 4) - smooth).values
    assert abs(np.corrcoef(again.ravel(), detail.ravel())[0, 1]) < 0.2
    np.testing.assert_array_equal(composed().height, found.height)
    assert abs(composed(seed=2).height - found.height).max() > 1e-5


@pytest.mark.parametrize("points", [POINTS, POINTS + 1])
def test_the_spectrum_is_that_of_scans_turned_a_quarter(points):
    """Waves along x and along y count alike."""
    at = axis_coordinates(points, PATCH / points)
    grooves = np.broadcast_to(1e-3 * np.sin(2 * np.pi * 9 * at / PATCH), 2 * (points,))
    flat = mesh_surface()
    flat["height"] = flat.height.copy(data=np.zeros(flat.height.shape))
    densities = []
    for turn in (0, 1):
        scan = make_surface(np.rot90(grooves, turn), PATCH / points).to_dataset(name="height")
        of = dict.fromkeys(PLACES.patch, scan)
        settings = {"patch_mm": PATCH, "s_filter_um": None, "placement_um": 10.0, "seed": 1}
        densities.append(compose_surface(flat, PLACES, of, **settings).density)
    np.testing.assert_allclose(densities[0], densities[1], rtol=1e-9, atol=1e-20)


def test_the_mesh_errors_have_the_size_of_the_left_out_errors():
    face = mesh_surface(error=2e-3)
    drawn = draw_mesh_errors(face, face.height, 50, np.random.default_rng(0))
    assert drawn.shape == (50, COUNT, COUNT)
    # each is the mean of about three vertices' errors
    assert 0.5 * 2e-3 < drawn.std() < 1.0 * 2e-3
    assert abs(drawn.mean()) < 2e-4


def test_a_plane_that_the_mesh_does_not_know_is_left_level():
    """It is known if its tilt exceeds the errors of both slopes together."""
    sure, lost = (composed(error=error, placement_um=0.0) for error in (0.0, 0.05))
    assert sure.known.all()
    known = []
    for tilt_over_error in (1.3, 1.6):  # of patch a; the error grows with that of the mesh
        is_now = float((lost.tilt_mrad / lost.tilt_error_mrad)[0])
        found = composed(error=0.05 * is_now / tilt_over_error, placement_um=0.0)
        ratio = found.tilt_mrad / found.tilt_error_mrad
        assert float(ratio[0]) == pytest.approx(tilt_over_error, abs=0.05)
        np.testing.assert_array_equal(found.known, ratio > np.sqrt(2))
        laid = (found.slope_x != 0) & (found.slope_y != 0)
        np.testing.assert_array_equal(laid, found.known)
        known.append(bool(found.known[0]))
    assert known == [False, True]


def test_the_error_of_a_plane_is_that_of_mesh_place_and_unseen_waves():
    """The mesh's is above; of a place on a curved stone, and of waves that the scans show."""
    still, smooth, rough = (
        composed(scans(detail), error=0.0, placement_um=0.0).tilt_error_mrad
        for detail in (1e-6, 1e-3, 1e-2)
    )
    np.testing.assert_allclose(rough, 10 * smooth, rtol=0.1)
    moved = composed(scans(1e-6), error=0.0, placement_um=20.0).tilt_error_mrad
    assert (moved > 5 * still).all()
    further = composed(scans(1e-6), error=0.0, placement_um=40.0).tilt_error_mrad
    np.testing.assert_allclose(further, 2 * moved, rtol=0.1)


def test_at_the_scans_resolution_each_draw_has_other_detail_and_the_same_scans():
    face, of, composite = mesh_surface(), scans(), composed()
    draws = [
        composite_heights(face, composite, of, s_filter_um=s_filter_um, seed=1, draw=draw)
        for s_filter_um, draw in ((None, 0), (None, 1), (None, 0), (60.0, 0))
    ]
    first, other, again, filtered = (draw.values for draw in draws)
    assert first.shape == 2 * (round(SIDE * POINTS / PATCH),)
    np.testing.assert_array_equal(first, again)
    at = slice(64, 128), slice(48, 112)  # patch a, not turned, about x 1 and y 1.2
    np.testing.assert_array_equal(first[at], other[at])
    assert (first - other)[:, 300:].std() > 5e-4
    a = composite.sel(patch="a")
    along = (np.arange(POINTS) + 0.5) * PATCH / POINTS - PATCH / 2
    plane = float(a.offset) + float(a.slope_y) * along[:, None] + float(a.slope_x) * along
    height = of["a"].height
    np.testing.assert_allclose(first[at], height.values + plane, atol=1e-9)
    np.testing.assert_allclose(filtered[at], s_filtered(height, 60.0).values + plane, atol=1e-9)
