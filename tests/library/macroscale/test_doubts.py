"""Doubts about a contact: each is raised by what it names, and by nothing else."""

import re

import numpy as np
import pytest
from contacts import interface

from gstlib.contact import Load, contact_at_pressure
from gstlib.macroscale.plausibility import plausibility_warnings
from gstlib.surfaces.grid import axis_coordinates, make_surface

SIDE, COUNT = 6.0, 60  # mm, elements
ALONG = axis_coordinates(COUNT, SIDE / COUNT) - SIDE / 2
Y, X = np.meshgrid(ALONG, ALONG, indexing="ij")


def domes(*middles):
    """Heights of domes about some middles (y, x), from the middle of the surface."""
    return np.max([-((Y - y) ** 2 + (X - x) ** 2) / 40 for y, x in middles], axis=0)


def spiked(height, by):
    return height + by * (np.maximum(abs(Y - ALONG[30]), abs(X - ALONG[30])) < 1e-9)


def doubts(height, *, force=200.0, load_point=(3.0, 3.0), size_mm=SIDE, patch_mm=0.8):
    """What is said of the contact of a surface."""
    surface = make_surface(height, SIDE / COUNT)
    contact = contact_at_pressure(
        interface(surface),
        Load.of_force(force, surface, load_point),
        modulus=1e4,
        tolerance=1e-6,
        source="test",
    )
    return list(plausibility_warnings(contact, size_mm=size_mm, patch_mm=patch_mm))


TRIANGLE = domes((-1.2, -1.2), (-1.2, 1.2), (1.4, 0.0))
FAR = domes((-0.2, -0.2), (-0.2, 2.2), (2.4, 1.0))
ENDS = np.where(abs(X) < 1.5, 0.0, np.nan)
SINGLE = 30.5 * SIDE / COUNT


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"force": 0.5, "load_point": (1.98, 3.0)},  # well inside the outline
        {"patch_mm": None},
    ],
)
def test_a_sound_contact_raises_no_doubt(options):
    assert doubts(TRIANGLE, **options) == []


@pytest.mark.parametrize(
    ("height", "options", "doubt"),
    [
        (ENDS, {"load_point": None}, "The stone continues there, or ends"),
        (spiked(TRIANGLE, 0.2), {"force": 900.0}, "above the strength of stone"),
        (
            spiked(np.full((COUNT, COUNT), -1.0), 1.0),
            {"force": 1.0, "load_point": (SINGLE, SINGLE)},
            "at a single point",
        ),
        (FAR, {"load_point": (4.0, 4.0), "size_mm": 1.0}, "only .* in the square"),
        (TRIANGLE, {"patch_mm": 0.49}, r"0.49 mm is 4.9 elements"),
        # a flat punch bears far more at its edges than their share of the area
        (np.zeros((COUNT, COUNT)), {"load_point": None}, "[2-9]. % of the force acts"),
        (TRIANGLE, {"force": 0.5, "load_point": (1.83, 3.0)}, r"only 0\.0.* mm inside"),
        (TRIANGLE + 0.25 * Y, {}, "tilted by 2[45]. mrad"),
        (TRIANGLE + 0.25 * X, {}, "tilted by 2[45]. mrad"),
    ],
)
def test_a_doubt_names_its_cause(height, options, doubt):
    assert any(re.search(doubt, sentence) for sentence in doubts(height, **options))
