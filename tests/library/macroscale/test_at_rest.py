"""The stone at rest: force and moments balance, and no plane of a frame or a mesh decides anything.

Each level lies in the one above as a patch lies in the face: at its resolution, it is the same
contact again.
"""

from dataclasses import astuple

import numpy as np
import pytest
import xarray as xr
from contacts import around, interface
from gstlib.bem.closed_forms import Sphere
from gstlib.conditions import load_force, resolved_load_point
from gstlib.contact import Load, contact_at_pressure, contact_path
from gstlib.coupling.embedding import placed_faces
from gstlib.macroscale.active_tool import as_round_as, rounded_counterface
from gstlib.macroscale.composite import plane_under
from gstlib.macroscale.equilibrium import macroscale_table
from gstlib.macroscale.face import without_curvature
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.footprints import PatchPosition, on_patch, spline_of, square_of
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import Plane, remove_plane
from gstlib.validation.single_scale import solve_reference

MODULUS = 1e4
# A face of 6 mm around a square of 3 mm, whose corner is at (0, 0).
SIZE, ELEMENT, COUNT, AROUND = 3.0, 0.1, 60, 15
SOURCE = {"modulus": MODULUS, "tolerance": 1e-9, "source": "face"}


def rough(seed=1):
    waves = smooth_field(np.random.default_rng(seed), COUNT, ELEMENT, 0.4)
    return around(2e-3 * waves.astype(float), ELEMENT, AROUND * ELEMENT)


def plane(face, slope_y, slope_x):
    heights = slope_y * face.y.values[:, None] + slope_x * face.x.values
    return face.copy(data=face.values + heights)


def at_rest(face, counterface=None, *, force_N=300.0, load_point=(1.6, 1.3), tolerance=1e-9):
    load = Load.of_force(force_N, face, load_point)
    settings = SOURCE | {"tolerance": tolerance}
    return contact_at_pressure(interface(face, counterface), load, **settings)


def slope_of(contact, name):
    """Of the plane on which the body is in equilibrium."""
    return getattr(contact.interface.plane, name)


def force_and_centre(contact):
    """Force (N) and the place (y, x), mm, through which the pressures act."""
    forces = contact.pressure * np.prod(spacing_of(contact.pressure))
    force = float(forces.sum())
    return force, [float((forces * forces[axis]).sum()) / force for axis in "yx"]


@pytest.mark.parametrize(
    ("load", "force_N", "point"),
    [
        ({"force_N": 400.0, "at_mm": [3.2, 2.1]}, 400.0, (2.1, 3.2)),
        ({"force_N": None, "pressure_MPa": 20.0, "at_mm": None}, 500.0, (2.5, 2.5)),
    ],
)
def test_a_load_is_a_force_or_a_pressure(load, force_N, point):
    assert load_force(load, 5.0) == force_N
    assert resolved_load_point(load, 5.0) == point


# --- Planes and load point ------------------------------------------------------------------


def test_a_plane_changes_the_tilt_by_itself_and_nothing_else():
    face = rough()
    over = rounded_counterface(face, 80.0, (1.5, 1.5))
    straight, askew = at_rest(face, over), at_rest(plane(face, 5e-3, -8e-3), over)
    scale = float(straight.pressure.max())
    np.testing.assert_allclose(askew.pressure, straight.pressure, atol=1e-5 * scale)
    for slope, by in (("slope_y", 5e-3), ("slope_x", -8e-3)):
        assert slope_of(askew, slope) == pytest.approx(slope_of(straight, slope) - by, abs=1e-9)
    force, centre = force_and_centre(straight)
    assert force == pytest.approx(300.0, rel=1e-9)
    np.testing.assert_allclose(centre, (1.6, 1.3), atol=1e-6)
    held = Load(straight.load.mean_pressure)
    fixed = contact_at_pressure(interface(face, over), held, **SOURCE)
    assert abs(fixed.pressure - straight.pressure).max() > 0.1 * scale


@pytest.mark.parametrize("missing", [0, 6])
def test_the_load_path_of_a_face_at_rest_ends_at_its_contact(missing):
    face = plane(rough(), 3e-3, 2e-3)
    face[:missing] = np.nan
    contact = at_rest(face)
    settings = {"steps": 5, "maximum_displacement_um": 100.0, "every_step": True}
    path = contact_path(interface(face), contact.load, **SOURCE, **settings)
    scale = float(contact.pressure.max())
    np.testing.assert_allclose(path.final.pressure, contact.pressure, atol=1e-5 * scale)
    assert path.final.displacement == pytest.approx(contact.displacement, rel=1e-6)
    assert path.final.load == contact.load
    for slope in ("slope_y", "slope_x"):
        assert slope_of(path.final, slope) == pytest.approx(slope_of(contact, slope), abs=1e-9)
    assert float(path.mean_pressure[-1]) == pytest.approx(300 / (COUNT * ELEMENT) ** 2)
    assert macroscale_table(path.to_dataset()).force_N.iloc[-1] == pytest.approx(300)


# --- What meets the face -------------------------------------------------------------------------


def test_an_ellipsoidal_stone_has_a_radius_along_an_axis_and_one_across_it():
    face, middle, turn = 0 * rough(), (1.5, 1.5), np.radians(30)
    over = rounded_counterface(face, (80.0, 20.0), middle, 30.0)
    along, across = 0.7, -0.4
    y = middle[0] + along * np.sin(turn) + across * np.cos(turn)
    x = middle[1] + along * np.cos(turn) - across * np.sin(turn)
    expected = -(along**2) / 160 - across**2 / 40
    assert float(spline_of(over).ev(y, x)) == pytest.approx(expected, rel=1e-4)
    scaled = as_round_as(over, 40.0, 80.0)  # the geometric mean, doubled
    np.testing.assert_allclose(scaled, rounded_counterface(face, (160.0, 40.0), middle, 30.0))


def test_the_curvature_of_the_square_is_taken_out_of_the_whole_face():
    bare = xr.Dataset({"height": rough(), "size_mm": SIZE})
    bent = bare.height + rounded_counterface(bare.height, (-90.0, 300.0), (1.2, 1.9), 20.0)
    found = without_curvature(bare.assign(height=bent)).height
    apart = found - without_curvature(bare).height
    np.testing.assert_allclose(remove_plane(apart)[0], 0, atol=1e-12)


@pytest.mark.parametrize("own_radius", [None, -120.0, 60.0])
def test_a_rounded_stone_touches_as_hertz_says(own_radius):
    """A flat, a hollow and a round face: 1/R = 1/R₁ + 1/R₂, below the load point."""
    radius, load_point = 40.0, (1.7, 1.3)
    face = 0 * rough()
    if own_radius is not None:
        face = rounded_counterface(face, own_radius, (1.5, 1.5))
    contact = at_rest(face, rounded_counterface(face, radius, (1.5, 1.5)), load_point=load_point)
    both = 1 / (1 / radius + (0 if own_radius is None else 1 / own_radius))
    exact = Sphere(300.0, both, MODULUS)
    expected = exact.pressure(face.x.values - load_point[1], face.y.values[:, None] - load_point[0])
    peak = exact.peak_pressure
    assert np.sqrt(np.mean((contact.pressure.values - expected) ** 2)) < 0.01 * peak
    assert float(contact.pressure.max()) == pytest.approx(peak, rel=0.02)
    # it rolls until its summit faces the force
    for slope, at in (("slope_y", load_point[0]), ("slope_x", load_point[1])):
        assert slope_of(contact, slope) == pytest.approx((at - 1.5) / both, abs=1e-6)


def test_where_there_is_no_stone_nothing_is_borne():
    """As if the face fell away there, for the contact and for the planes under patches."""
    face = rough()
    cut = face.copy()
    cut[:4], cut[:, -7:] = np.nan, np.nan
    absent = np.isnan(cut.values)
    contact = at_rest(cut)
    assert not contact.pressure.values[absent].any()
    assert np.isnan(contact.gap.values[absent]).all()
    pit = at_rest(cut.fillna(-1.0))
    scale = float(pit.pressure.max())
    np.testing.assert_allclose(contact.pressure, pit.pressure, atol=1e-5 * scale)
    # a missing active tool bears as little as a missing passive one
    over = 0 * face.where(~absent)
    other = at_rest(face, over)
    np.testing.assert_allclose(other.pressure, contact.pressure, atol=1e-5 * scale)
    for place in (PatchPosition(1.5, 1.5, 0.0), PatchPosition(1.2, 1.4, 25.0)):
        found, whole = (astuple(plane_under(spline_of(of), place, 0.8)) for of in (cut, face))
        np.testing.assert_allclose(found, whole, atol=1e-6)


# --- A level within the one above ----------------------------------------------------------------


@pytest.fixture(scope="module", params=[None, 60.0], ids=["flat", "round"])
def larger(request):
    """The contact of the face at rest, askew, so that its tilt matters."""
    face = plane(rough(), 6e-3, -4e-3)
    return at_rest(face, rounded_counterface(face, request.param, (1.5, 1.5)), force_N=900.0)


def placed(larger, place, size, *, laid=True):
    """The contact of a piece that is cut out of a larger one and placed in it, at its force."""
    count = round(size / ELEMENT)
    piece = make_surface(
        on_patch(spline_of(larger.interface.height), place, (count, count), size), ELEMENT
    )
    own = Plane(0.0, 0.0, 0.0)
    if laid:  # as a scan, level, on a plane of its own
        piece, own = remove_plane(piece)
    slopes = own.slope_y, own.slope_x
    faces = placed_faces(piece, None, larger, place, size_mm=size, slopes=slopes)
    expected = on_patch(spline_of(larger.pressure), place, (count, count), size)
    return contact_at_pressure(faces, Load(float(expected.mean())), **SOURCE), expected


@pytest.mark.parametrize("laid", [False, True], ids=["as it is", "levelled"])
@pytest.mark.parametrize("rotation", [0.0, 90.0, -90.0, 180.0])
def test_a_square_placed_in_a_larger_contact_has_its_pressures(larger, rotation, laid):
    place = PatchPosition(2.2, 2.0, rotation)
    contact, expected = placed(larger, place, 1.2, laid=laid)
    scale = float(larger.pressure.max())
    assert (expected > 0.2 * scale).sum() > 5
    assert 0.05 < (expected > 1e-9).mean() < 0.97
    np.testing.assert_allclose(contact.pressure, expected, atol=1e-3 * scale)


def test_a_scan_turned_by_any_angle_lies_on_the_turned_plane(larger):
    """Its plane (mm) at its own points is that of the larger one, where they lie on it."""
    piece = make_surface(np.zeros((12, 12)), 0.1)
    place = PatchPosition(1.6, 1.4, 33.0)
    faces = placed_faces(piece, None, larger, place, size_mm=1.2)
    at = (np.arange(12) - 5.5) * 0.1
    v, u = at[:, None], at
    y, x = place.points(v, u)
    laid = faces.plane.slope_y * v + faces.plane.slope_x * u
    tilt = slope_of(larger, "slope_y"), slope_of(larger, "slope_x")
    expected = tilt[0] * (y - place.y_mm) + tilt[1] * (x - place.x_mm)
    np.testing.assert_allclose(laid, expected, atol=1e-12)
    assert np.ptp(expected) > 1e-3
    # a scan of the active tool lies on the plane that its face has there
    scan = piece.copy(data=np.random.default_rng(1).standard_normal(piece.shape))
    scanned = placed_faces(piece, scan, larger, place, size_mm=1.2).counterface
    level, _ = remove_plane(faces.counterface)
    np.testing.assert_allclose(scanned - scan, faces.counterface - level, atol=1e-12)


def test_the_square_at_the_faces_resolution_is_the_face_again(larger):
    """The reference, placed in the face: its plane, its surroundings, its share of the force."""
    found = solve_reference(square_of(larger.interface.height, SIZE), larger)
    inside = square_of(larger.pressure, SIZE)
    scale = float(inside.max())
    assert 0.1 < float(inside.sum() / larger.pressure.sum()) < 0.995
    np.testing.assert_allclose(found.pressure, inside, atol=0.01 * scale)
    assert float(found.pressure.sum()) == pytest.approx(float(inside.sum()), rel=1e-4)
    np.testing.assert_allclose(
        found.height, remove_plane(square_of(larger.interface.height, SIZE))[0], atol=1e-7
    )
