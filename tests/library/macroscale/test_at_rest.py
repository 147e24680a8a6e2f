"""The stone at rest: force and moments balance, and no plane of a frame or a mesh decides anything.

Each level lies in the one above as a patch lies in the face: at its resolution, it is the same
contact again.
"""

from dataclasses import astuple

import numpy as np
import pytest
from contacts import around, interface
from numpy.testing import assert_allclose

from gstlib.bem.closed_forms import Sphere
from gstlib.contact import Load, contact_at_pressure
from gstlib.coupling.embedding import placed_faces
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.composite import plane_under
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.footprints import PatchPosition, on_patch, spline_of, square_of
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.single_scale import solve_reference

MODULUS = 1e4
# A face of 6 mm around a square of 3 mm, whose corner is at (0, 0).
SIZE, ELEMENT, COUNT, AROUND = 3.0, 0.1, 60, 15
MIDDLE = (1.5, 1.5)
SOLVING = {"modulus": MODULUS, "tolerance": 1e-9, "source": "face"}


def rough():
    generator = np.random.default_rng(1)
    waves = smooth_field(generator, COUNT, ELEMENT, 0.4).astype(float)
    return around(2e-3 * waves, ELEMENT, AROUND * ELEMENT)


def tilted(face, slope_y, slope_x):
    plane = slope_y * face.y.values[:, None] + slope_x * face.x.values
    return face.copy(data=face.values + plane)


def at_rest(face, counterface=None, *, force_N=300.0, load_point=(1.6, 1.3)):
    load = Load.of_force(force_N, face, load_point)
    return contact_at_pressure(interface(face, counterface), load, **SOLVING)


def slopes(contact):
    """Of the plane on which the body is in equilibrium, along y and x."""
    plane = contact.interface.plane
    return np.array([plane.slope_y, plane.slope_x])


def assert_same_pressures(contact, other, atol=1e-5):
    """Within a share of the highest pressure."""
    scale = float(other.pressure.max())
    assert_allclose(contact.pressure, other.pressure, atol=atol * scale)


# --- Planes and load point ------------------------------------------------------------------


def test_a_plane_changes_the_tilt_by_itself_and_nothing_else():
    face = rough()
    over = rounded_counterface(face, 80.0, MIDDLE)
    straight = at_rest(face, over)
    askew = at_rest(tilted(face, 5e-3, -8e-3), over)
    assert_same_pressures(askew, straight)
    assert_allclose(slopes(straight) - slopes(askew), (5e-3, -8e-3), atol=1e-9)
    forces = straight.pressure * np.prod(spacing_of(face))
    assert float(forces.sum()) == pytest.approx(300.0, rel=1e-9)
    centre = [float((forces * forces[axis]).sum()) / 300 for axis in "yx"]
    assert_allclose(centre, (1.6, 1.3), atol=1e-6)


# --- What meets the face -------------------------------------------------------------------------


@pytest.mark.parametrize("own_radius", [np.inf, -120.0])
def test_a_rounded_stone_touches_as_hertz_says(own_radius):
    """A flat and a hollow face: 1/R = 1/R₁ + 1/R₂, below the load point."""
    load_point = 1.7, 1.3
    face = rounded_counterface(0 * rough(), own_radius, MIDDLE)
    over = rounded_counterface(face, 40.0, MIDDLE)
    contact = at_rest(face, over, load_point=load_point)
    radius = 1 / (1 / 40.0 + 1 / own_radius)
    exact = Sphere(300.0, radius, MODULUS)
    expected = exact.pressure(
        face.x.values - load_point[1], face.y.values[:, None] - load_point[0]
    )
    peak = exact.peak_pressure
    misfit = contact.pressure.values - expected
    assert np.sqrt(np.mean(misfit**2)) < 0.01 * peak
    assert float(contact.pressure.max()) == pytest.approx(peak, rel=0.02)
    # it rolls until its summit faces the force
    rolled = np.subtract(load_point, MIDDLE) / radius
    assert_allclose(slopes(contact), rolled, atol=1e-6)


def test_where_there_is_no_stone_nothing_is_borne():
    """As if the face fell away there, for the contact and for the planes under patches."""
    face = rough()
    cut = face.copy()
    cut[:4], cut[:, -7:] = np.nan, np.nan
    absent = np.isnan(cut.values)
    contact = at_rest(cut)
    assert not contact.pressure.values[absent].any()
    assert_same_pressures(contact, at_rest(cut.fillna(-1.0)))
    # a missing active tool bears as little as a missing passive one
    other = at_rest(face, 0 * face.where(~absent))
    assert_same_pressures(other, contact)
    place = PatchPosition(1.2, 1.4, 25.0)
    planes = [
        astuple(plane_under(spline_of(surface), place, 0.8)) for surface in (cut, face)
    ]
    assert_allclose(*planes, atol=1e-6)


# --- A level within the one above ----------------------------------------------------------------


def askew(end=np.inf):
    """The face at rest, with a tilt that matters, under a tool that ends somewhere along x."""
    face = tilted(rough(), 6e-3, -4e-3)
    over = rounded_counterface(face, 60.0, MIDDLE)
    return at_rest(face, over.where(over.x < end), force_N=900.0)


@pytest.mark.parametrize("end", [np.inf, 2.0])
@pytest.mark.parametrize(
    ("rotation", "is_laid"), [(0.0, False), (90.0, True), (180.0, True)]
)
def test_a_square_placed_in_a_larger_contact_has_its_pressures(end, rotation, is_laid):
    """A piece that is cut out of the larger one and placed in it, as it is or levelled."""
    larger, size, shape = askew(end), 1.2, (12, 12)
    place = PatchPosition(2.2, 2.0, rotation)
    heights = on_patch(spline_of(larger.interface.height), place, shape, size)
    piece, slopes = make_surface(heights, ELEMENT), (0.0, 0.0)
    if is_laid:
        piece, own = remove_plane(piece)
        slopes = own.slope_y, own.slope_x
    faces = placed_faces(piece, None, larger, place, size_mm=size, slopes=slopes)
    expected = on_patch(spline_of(larger.pressure), place, shape, size)
    contact = contact_at_pressure(faces, Load(float(expected.mean())), **SOLVING)
    scale = float(larger.pressure.max())
    assert 0.05 < (expected > 1e-9).mean() < 0.97
    assert_allclose(contact.pressure, expected, atol=1e-3 * scale)


def test_the_square_at_the_faces_resolution_is_the_face_again():
    """The reference, placed in the face: its plane, its surroundings, its share of the force."""
    larger = askew()
    square = square_of(larger.interface.height, SIZE)
    reference = solve_reference(square, larger)
    inside = square_of(larger.pressure, SIZE)
    assert 0.1 < float(inside.sum() / larger.pressure.sum()) < 0.995
    scale = float(inside.max())
    assert_allclose(reference.pressure, inside, atol=0.01 * scale)
    assert float(reference.pressure.sum()) == pytest.approx(
        float(inside.sum()), rel=1e-4
    )
    level, _ = remove_plane(square)
    assert_allclose(reference.height, level, atol=1e-7)
