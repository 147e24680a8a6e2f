"""Measured pairs whose right answer is known: nothing changed, or the surfaces are not the same.

They are skipped where the files are absent. PROVENANCE.md beside them says whose they are.
"""

from itertools import combinations, starmap
from pathlib import Path

import numpy as np
import pytest

from gstlib.change.change import estimate_detection_limit, measured_change, wear_summary
from gstlib.change.registration import register
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.grid import make_surface, spacing_of

DATA = Path(__file__).parents[4] / "shared/data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

# Trace and retrace of an atomic force microscope: file, channels, and the shift (y, x) in points
# at which their details correlate best. The two share their lines, so nothing moves far along y.
REPEATS = {
    "di-1": ("repeat-mit/di-1.di", (0, 1), (0, 6)),
    "di-2": ("repeat-mit/di-2.di", (0, 1), (0, 14)),
    "di-6": ("repeat-mit/di-6.di", (0, 1), (0, 0)),
    "nid-1, Z axis": ("repeat-mit/nid-1.nid", (0, 2), (0, 6)),
    "nid-1, Z sensor": ("repeat-mit/nid-1.nid", (1, 3), (-1, 2)),
    "spot_1": ("repeat-mit/spot_1-1000nm.ibw", (0, 1), (0, -1)),
    "uncd35": ("repeat-ccby/uncd35.di", (0, 1), (0, 6)),
}
# Of these, errors are alike over more points than the others': their loss is stated, but as noise.
AS_NOISE = {"di-2", "di-6"}
# Lengths are so many times as large as measured, because the limits are those of confocal scans.
LARGER = 1000
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


@pytest.fixture(scope="module", params=REPEATS)
def repeat(request):
    """The name, both measurements, the settings, and the expected shift (y, x), mm."""
    pytest.importorskip("SurfaceTopography", reason="it reads the files")
    from SurfaceTopography import open_topography
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    file, channels, shift = REPEATS[request.param]
    scans = []
    for number in channels:
        topography = open_topography(DATA / file).topography(channel_index=number)
        mm = LARGER * get_unit_conversion_factor(topography.unit, "mm")
        heights = np.asarray(topography.heights(), dtype=float).T * mm
        spacing = topography.physical_sizes[0] * mm / heights.shape[1]
        scans.append(prepare_scan(make_surface(heights, spacing)))
    settings = {
        "maximum_shift_mm": 0.7 * len(heights) * spacing,
        "minimum_cluster_points": 8,
    }
    return request.param, scans, settings, spacing * np.array(shift)


def shows_wear(name, change):
    """Whether more than 0.5 % is lost or gained; what is unknown is neither."""
    extent = wear_summary(change)
    if (
        name in AS_NOISE and extent["gain_to_loss_ratio"] > 0.2
    ):  # the limit of the default study
        return False
    return max(extent["loss_fraction"], extent["gain_fraction"]) > 0.005


def test_a_repeat_is_registered_where_its_details_match_and_shows_no_wear(repeat):
    """Neither by its own level of detection nor by the error that the repeat shows."""
    name, (first, second), settings, shift_mm = repeat
    detection = estimate_detection_limit({"": first}, {"": second}, **settings)
    for limit in (None, detection):
        change = measured_change(first, second, detection=limit, **settings)
        assert not shows_wear(name, change)
    found = change.attrs
    off_mm = 1e-3 * np.array([found["shift_y_um"], found["shift_x_um"]]) - shift_mm
    assert np.abs(off_mm).max() < 5 * spacing_of(first.height)[0]
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
