"""Measured pairs whose right answer is known: nothing changed, or the surfaces are not the same.

They are skipped where the files are absent. PROVENANCE.md beside them says whose they are, and
benchmarks/measured_surfaces.py how repeats are read.
"""

from itertools import combinations, starmap

import numpy as np
import pytest
from measured_surfaces import DATA, FILES, REACH, SETTINGS, channel

from gstlib.change.change import estimate_detection_limit, measured_change, wear_summary
from gstlib.change.registration import register
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.grid import make_surface, spacing_of

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

# Shifts (y, x) in points at which the details of trace and retrace correlate best. The two share
# their lines, so nothing moves far along y.
SHIFTS = {
    "di-1": (0, 6),
    "di-2": (0, 14),
    "di-6": (0, 0),
    "nid-1, Z axis": (0, 6),
    "nid-1, Z sensor": (-1, 2),
    "spot_1": (0, -1),
    "uncd35": (0, 6),
}
# Of these, errors are alike over more points than the others': their loss is stated, but as noise.
AS_NOISE = {"di-2", "di-6"}
# First row and column of a piece of the impression of a breech face, hardly any of it undefined.
PIECE = 78
IMPRESSIONS = {
    "TW01-01": (181, 15),
    "TW02-01": (465, 257),
    "TW03-02": (449, 281),
    "TW04-01": (329, 81),
    "TW05-01": (202, 48),
}
# The same places on other castings, and how these are turned (degrees).
SAME_FACE = {
    "TW02-01": ("TW02-02", (466, 253), -2.0),
    "TW03-02": ("TW03-03", (457, 245), 2.0),
}


def shows_wear(name, change):
    """Whether more than 0.5 % is lost or gained; what is unknown is neither."""
    extent = wear_summary(change)
    # the limit of the default study
    is_noise = name in AS_NOISE and extent["gain_to_loss_ratio"] > 0.2
    return (
        max(extent["loss_fraction"], extent["gain_fraction"]) > 0.005 and not is_noise
    )


@pytest.mark.parametrize("name", SHIFTS)
def test_a_repeat_is_registered_where_its_details_match_and_shows_no_wear(name):
    """Neither by its own level of detection nor by the error that the repeat shows."""
    pytest.importorskip("SurfaceTopography", reason="it reads the files")
    file, *channels = FILES["repeats"][name]
    first, second = (channel(file, number) for number in channels)
    spacing = spacing_of(first.height)[0]
    settings = SETTINGS | {"maximum_shift_mm": REACH * len(first.height) * spacing}
    detection = estimate_detection_limit({"": first}, {"": second}, **settings)
    for limit in (None, detection):
        change = measured_change(first, second, detection=limit, **settings)
        assert not shows_wear(name, change)
    found = change.attrs
    shift_um = np.array([found["shift_y_um"], found["shift_x_um"]])
    assert np.abs(shift_um / (1e3 * spacing) - SHIFTS[name]).max() < 5
    assert abs(found["rotation_deg"]) < 0.5


def piece_of(name, corner):
    scan = read_scan(DATA / f"breechface-ccby/{name}.x3p")
    row, column = corner
    piece = scan.values[row : row + PIECE, column : column + PIECE]
    return prepare_scan(make_surface(piece, spacing_of(scan))).height


def matched(first, second):
    return register(first, second, maximum_shift_mm=0.3)


def test_impressions_of_two_breech_faces_are_not_found_on_each_other():
    pieces = starmap(piece_of, IMPRESSIONS.items())
    assert not any(matched(*pair).is_reliable for pair in combinations(pieces, 2))


def test_impressions_of_one_breech_face_are_found_on_each_other():
    for name, (other, corner, turn_deg) in SAME_FACE.items():
        match = matched(piece_of(name, IMPRESSIONS[name]), piece_of(other, corner))
        assert match.is_reliable
        assert match.rotation_deg == pytest.approx(turn_deg, abs=0.1)
        assert np.hypot(match.shift_y_mm, match.shift_x_mm) < 0.01
