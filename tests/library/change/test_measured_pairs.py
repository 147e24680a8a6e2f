"""Measured pairs of which the right answer is known: nothing changed.

They are skipped where the files are absent. PROVENANCE.md beside them says whose they are.
"""

from pathlib import Path

import numpy as np
import pytest
from gstlib.change.change import estimate_detection_limit, measured_change, wear_summary
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.grid import make_surface, spacing_of

DATA = Path(__file__).parents[4] / "shared/data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

# Trace and retrace of an atomic force microscope: file, channels, and the shift (y, x) in points
# at which their details correlate best. The two share their lines, so nothing moves far along y.
REPEATS = {
    "di-2": ("repeat-mit/di-2.di", (0, 1), (0, 14)),
    "di-6": ("repeat-mit/di-6.di", (0, 1), (0, 0)),
    "nid-1, Z axis": ("repeat-mit/nid-1.nid", (0, 2), (0, 6)),
}
# Of these, errors are alike over more points than the others': their loss is stated, but as noise.
AS_NOISE = {"di-2", "di-6"}
# Lengths are so many times as large as measured, because the limits are those of confocal scans.
LARGER = 1000


def scans_of(name):
    """Both measurements, prepared."""
    pytest.importorskip("SurfaceTopography", reason="it reads the files")
    from SurfaceTopography import open_topography
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    file, channels, _ = REPEATS[name]
    for number in channels:
        topography = open_topography(DATA / file).topography(channel_index=number)
        mm = LARGER * get_unit_conversion_factor(topography.unit, "mm")
        heights = np.asarray(topography.heights(), dtype=float).T * mm
        spacing = topography.physical_sizes[0] * mm / heights.shape[1]
        yield prepare_scan(make_surface(heights, spacing))


def shows_wear(name, change):
    """Whether more than 0.5 % is lost or gained; unknown points are neither."""
    summary = wear_summary(change)
    # the limit of the default study
    if name in AS_NOISE and summary["gain_to_loss_ratio"] > 0.2:
        return False
    return max(summary["loss_fraction"], summary["gain_fraction"]) > 0.005


@pytest.mark.parametrize("name", REPEATS)
def test_a_repeat_is_registered_where_its_details_match_and_shows_no_wear(name):
    """Neither by the error of its unchanged part nor by the error that it shows as a repeat."""
    first, second = scans_of(name)
    spacing = spacing_of(first.height)[0]
    field_mm = len(first.y) * spacing
    settings = {"maximum_shift_mm": 0.7 * field_mm, "minimum_cluster_points": 8}
    match, change = measured_change(first, second, **settings)
    shift = np.array([match.shift_y_mm, match.shift_x_mm]) / spacing
    assert np.abs(shift - REPEATS[name][2]).max() < 5
    assert abs(match.rotation_deg) < 0.5
    assert not shows_wear(name, change)
    detection = estimate_detection_limit({"": first}, {"": second}, **settings)
    _, change = measured_change(first, second, detection=detection, **settings)
    assert not shows_wear(name, change)
