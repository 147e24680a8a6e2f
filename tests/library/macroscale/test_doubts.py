"""Doubts about a contact: each is raised by what it names, and by nothing else."""

import re

import numpy as np
import pytest
from contacts import interface
from gstlib.contact import Load, contact_at_pressure
from gstlib.macroscale.face import largest_face
from gstlib.macroscale.plausibility import plausibility_warnings
from gstlib.surfaces.grid import make_surface

SIDE, COUNT = 6.0, 60  # mm, elements


def pressed(height, *, force=200.0, load_point=(3.0, 3.0), element=SIDE / COUNT):
    surface = make_surface(height, element)
    settings = {"modulus": 1e4, "tolerance": 1e-6, "source": "test"}
    load = Load.of_force(force, surface, load_point)
    return contact_at_pressure(interface(surface), load, **settings)


def places():
    along = (np.arange(COUNT) + 0.5) * SIDE / COUNT - SIDE / 2
    return np.meshgrid(along, along, indexing="ij")


def domes(*middles, radius=20.0):
    """Heights of domes about some middles (y, x), from the middle of the surface."""
    y, x = places()
    of = [-((y - b) ** 2 + (x - a) ** 2) / (2 * radius) for b, a in middles]
    return np.max(of, axis=0)


TRIANGLE = (-1.2, -1.2), (-1.2, 1.2), (1.4, 0.0)


def said(contact, **settings):
    return list(plausibility_warnings(contact, **{"size_mm": SIDE, "patch_mm": 0.8} | settings))


def test_a_sound_contact_raises_no_doubt():
    assert said(pressed(domes(*TRIANGLE))) == []


def test_load_at_the_edge_of_what_is_pressed():
    flat = np.zeros((COUNT, COUNT))
    (doubt,) = said(pressed(flat, load_point=None))
    # a flat punch bears far more at its edges than their share of the area
    share = float(doubt.split(" % of the force")[0])
    assert share > 100 * (1 - 0.96**2)


def spiked(height, at=(30, 30), by=0.2):
    height[at] += by
    return height


SINGLE = 30.5 * SIDE / COUNT
FAR = tuple((y + 1.0, x + 1.0) for y, x in TRIANGLE)
ENDS = np.where(abs(places()[1]) < 1.5, 0.0, np.nan)


@pytest.mark.parametrize(
    ("height", "loading", "square", "doubt"),
    [
        (ENDS, {"load_point": None}, {}, "the stone goes on there, or ends"),
        (spiked(domes(*TRIANGLE)), {"force": 900.0}, {}, "more than any stone bears"),
        (
            spiked(np.full((COUNT, COUNT), -1.0), by=1.0),
            {"force": 1.0, "load_point": (SINGLE, SINGLE)},
            {},
            "in a single place",
        ),
        (domes(*FAR), {"load_point": (4.0, 4.0)}, {"size_mm": 1.0}, "only .* in the square"),
    ],
)
def test_a_doubt_names_its_cause(height, loading, square, doubt):
    assert any(re.search(doubt, one) for one in said(pressed(height, **loading), **square))


def test_a_force_near_the_outline_of_what_touches():
    contact = pressed(domes(*TRIANGLE), force=0.5, load_point=(1.83, 3.0))
    (doubt,) = said(contact)
    distance = float(doubt.split("only ")[1].split(" mm inside")[0])
    assert 0 <= distance < 0.02 * SIDE
    assert said(pressed(domes(*TRIANGLE), force=0.5, load_point=(1.98, 3.0))) == []


@pytest.mark.parametrize(("patch_mm", "count"), [(0.8, 0), (0.49, 1), (None, 0)])
def test_elements_too_coarse_for_a_patch(patch_mm, count):
    doubts = said(pressed(domes(*TRIANGLE)), patch_mm=patch_mm)
    assert len(doubts) == count
    assert all(f"{patch_mm:g} mm is {patch_mm / 0.1:.1f} elements" in doubt for doubt in doubts)


@pytest.mark.parametrize("along", [0, 1])
def test_a_stone_that_rests_steeply(along):
    contact = pressed(domes(*TRIANGLE) + 0.25 * places()[along])
    (doubt,) = said(contact)
    assert float(doubt.split("tilted by ")[1].split(" mrad")[0]) == pytest.approx(250, rel=0.05)


@pytest.mark.parametrize(("thickness", "side"), [(14.67, 14.6), (8.0, 8.0), (np.nan, np.inf)])
def test_the_largest_face_is_never_wider_than_the_stone_is_thick(thickness, side):
    assert largest_face(thickness) == side
