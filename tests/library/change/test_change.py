"""Height change: levelled on what did not wear, with an honest level of detection."""

import numpy as np
import pandas as pd
import pytest
import scipy.ndimage
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.change.change import (
    Detection,
    estimate_detection_limit,
    height_change,
    measured_change,
    register_patch,
    wear_summary,
)
from gstlib.change.selection import other_heights, registration_table
from gstlib.macroscale.ensemble import patch_means
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.footprints import with_t1
from gstlib.surfaces.grid import make_surface

SPACING = 1.66e-3
SEARCH = {"maximum_shift_mm": 0.1, "minimum_cluster_points": 8}
RULES = {"minimum_overlap": 0.7, "minimum_correlation": 0.5}


def surface(heights):
    return make_surface(heights, SPACING)


def prepared(height, filled=False, outlier=False):
    """A scan as the preparation leaves it; the points `filled` or `outlier` were not measured."""
    no_point = height.copy(data=np.zeros(height.shape, dtype=bool))
    masks = {"filled": no_point | filled, "outlier": no_point | outlier}
    return xr.Dataset({"height": height} | masks)


def plateau(share):
    """T0 and T1 where the first `share` of the rows lost 2 µm, and a mask of them."""
    rng = np.random.default_rng(0)
    t0 = rng.normal(0, 3e-3, (80, 80))
    lost = np.zeros(t0.shape, dtype=bool)
    lost[: round(share * 80)] = True
    datum = 5e-3 + 1e-3 * SPACING * np.indices(t0.shape)[1]
    t1 = t0 - 2e-3 * lost + rng.normal(0, 1e-4, t0.shape) + datum
    return surface(t0), surface(t1), lost


@pytest.mark.parametrize("worn", [0.0, 0.2])
def test_a_change_below_the_step_of_stored_heights_is_not_seen(worn, caplog):
    noise = np.random.default_rng(4).normal(size=(3, 96, 96))
    stone = 24e-3 * scipy.ndimage.gaussian_filter(noise[0], 2.0)
    after = np.minimum(stone, np.quantile(stone, 1 - worn))
    heights = np.array([stone, after]) + 5e-5 * noise[1:]
    t0, t1 = (prepare_scan(surface(each)) for each in heights.round(3))
    change = register_patch(t0, t1, patch="7", **SEARCH)
    lost = wear_summary(change)["mean_wear_depth_um"]
    assert lost == pytest.approx(1e3 * np.mean(stone - after), rel=0.15, abs=0.002)
    assert change.attrs["level_of_detection_um"] == pytest.approx(0.8, rel=0.1)
    assert "steps of up to 1 µm" in caplog.text


@pytest.mark.parametrize("share", [0.0, 0.45])
def test_wear_of_nearly_half_does_not_pull_the_datum(share):
    t0, t1, lost = plateau(share)
    result = height_change(t0, t1)
    assert result["change"].values[~lost].mean() == pytest.approx(0, abs=0.02e-3)
    assert result["loss"].values[lost].sum() >= 0.99 * lost.sum()
    assert result.attrs["change_sigma_um"] == pytest.approx(0.1, rel=0.05)
    assert result.attrs["level_of_detection_um"] == pytest.approx(0.196, rel=0.05)
    summary, area = wear_summary(result), (80 * SPACING) ** 2
    # a fortieth of the unchanged part is noise beyond its own level of detection
    fraction, depth = summary["loss_fraction"], summary["mean_wear_depth_um"]
    assert fraction == pytest.approx(share + (1 - share) * 0.025, abs=0.01)
    assert depth == pytest.approx(2.0 * share, abs=0.01)
    assert summary["loss_area_mm2"] == pytest.approx(fraction * area)
    assert summary["mean_depth_where_worn_um"] == pytest.approx(depth / fraction)
    assert summary["loss_volume_um3"] == pytest.approx(depth * area * 1e6)


def test_points_without_two_measured_heights_are_unknown():
    t0, t1, _ = plateau(0.2)
    t1[:, :20] = np.nan
    measured = np.ones(t0.shape, dtype=bool)
    measured[30:40, 30:40] = False
    spoilt = t0 + 50e-3 * ~measured
    result = height_change(spoilt, t1, measured)
    assert_array_equal(np.isnan(result["t1"]), np.isnan(t1))
    measured[:, :20] = False
    expected = height_change(t0, t1, measured)["change"].where(measured)
    assert_allclose(result["change"], expected)
    assert not result["loss"].values[~measured].any()
    assert result.attrs["known_fraction"] == pytest.approx(1 - 1700 / 6400)


def test_smaller_spots_are_no_trace():
    t0 = surface(np.zeros((80, 80)))
    change = 1e-6 * np.random.default_rng(1).standard_normal(t0.shape)
    change[10, 10:13] = -1e-3  # three in a row
    change[[40, 41, 42, 43], [40, 41, 40, 41]] = -1e-3  # four, corner to corner
    change[60:62, 60:62] = 1e-3
    result = height_change(t0, t0 + change, minimum_cluster_points=4)
    traces = result[["loss", "gain"]].where(abs(change) > 1e-4, False).sum()
    assert (traces.loss, traces.gain) == (4, 4)


def test_the_same_scan_twice_shows_no_wear(remeasure):
    """Laid over itself, it differs by the rounding of single precision."""
    t0, _, _ = remeasure(spikes=0)
    again = t0.astype(np.float32).astype(float)
    search = SEARCH | {"minimum_cluster_points": 1}
    result = measured_change(prepared(t0), prepared(again), **search)
    assert result.attrs["registration_found"]
    summary = wear_summary(result)
    assert (summary["loss_fraction"], summary["gain_fraction"]) == (0, 0)
    assert 1.9e-4 * float(t0.std()) < result.attrs["level_of_detection_um"] < 1e-6


def test_from_prepared_scans_to_the_change(remeasure):
    t0, t1, truth = remeasure(1, (13.4, -9.7), wear=0.12, noise_um=0.05, spikes=0)
    hole0, hole1 = np.zeros((2, *t0.shape), dtype=bool)
    hole0[50, 50] = hole1[75, 75] = True
    scans = prepared(t0, filled=hole0), prepared(t1, outlier=hole1)
    result = measured_change(*scans, **SEARCH)
    assert result.attrs["registration_found"]
    is_known = np.isfinite(result["change"].values)
    assert not is_known[50, 50]
    # T1's point lies 13.4 rows further down and 9.7 columns to the left, between four of T0
    assert not is_known[88:90, 65:67].any()
    assert is_known[87:91, 64:68].sum() == 12
    loss = result["loss"].values
    deep = (truth < -1e-3) & is_known
    assert (truth < 0)[loss].mean() > 0.9
    assert loss[deep].mean() > 0.95
    error = (result["change"].values - truth)[is_known]
    assert np.median(error) == pytest.approx(0, abs=0.05e-3)
    assert np.median(np.abs(error)) < 0.3e-3
    # nothing is known of another stone
    other = measured_change(scans[0], prepared(remeasure(2)[0]), **SEARCH)
    assert np.isnan(wear_summary(other)["loss_fraction"])
    assert other.attrs["known_fraction"] == 0


@pytest.mark.parametrize("corner", [(25, 35), (0, 0)])
def test_the_place_of_t1_is_that_of_the_points_known_at_both_epochs(remeasure, corner):
    """T1 is turned, smaller or larger than T0, and its coordinates begin elsewhere."""
    t0, t1, _ = remeasure(1, (15, -12), 2.0, wear=0.05)
    row, column = corner
    t0, part = t0[10:110, 10:110], t1[row:, column:]
    place = {"x_mm": float(t0.x.mean()), "y_mm": float(t0.y.mean())}
    patches = pd.DataFrame({"patch": ["7"], "rotation_deg": 0.0} | place)
    change = register_patch(prepared(t0), prepared(part), patch="7", **SEARCH)
    table = registration_table({"7": change}, RULES, max_gain_to_loss_ratio=0.5)
    covered = with_t1(patches, table)
    weights = patch_means(t0, covered, size_mm=100 * SPACING).toarray()
    is_covered = weights.reshape(t0.shape) > 0.5 * weights.max()
    is_known = np.isfinite(change.change.values)
    assert (is_covered != is_known).mean() < 0.01
    assert is_known.mean() == pytest.approx(table.overlap[0], abs=0.02)


@pytest.mark.parametrize(
    ("factor", "refused", "warned"), [(1.15, 0, 0), (0.7, 0, 1), (2.5, 1, 0)]
)
def test_heights_of_another_scale_are_told_from_wear(
    remeasure, caplog, factor, refused, warned
):
    t0, t1, _ = remeasure(1, (10, -5), wear=0.05)
    change = register_patch(prepared(t0), prepared(factor * t1), patch="7", **SEARCH)
    table = registration_table({"7": change}, RULES, max_gain_to_loss_ratio=0.5)
    faults = list(other_heights(table))
    assert [fault.patches for fault in faults] == refused * [("7",)]
    assert sum("calibration" in message for message in caplog.messages) == warned


# --- The level of detection as repeated scans give it ------------------------------------------


def smooth(rng, size, scale):
    noise = rng.standard_normal((size, size))
    field = scipy.ndimage.gaussian_filter(noise, scale)
    return field / field.std()


def scanned_twice(
    relief, *, noise=0.1e-3, scatter=0.5, size=160, seed=0, loss=0.0, shift=(7, -4)
):
    """Two prepared scans of a stone with an r.m.s. `relief` (mm), the second laid elsewhere.

    Each point of the second lies off its place by `scatter` (r.m.s. along each axis, points), as
    instruments distort; no shift of the whole map makes up for it.
    """
    rng = np.random.default_rng(seed)
    stone = relief * smooth(rng, 2 * size, 5)
    distortions = [scatter * smooth(rng, 2 * size, 4) for _ in "yx"]
    places = np.indices((size, size)) + size // 2
    moved = places - np.reshape(shift, (2, 1, 1))
    off = [distortion[tuple(moved)] for distortion in distortions]
    worn = stone - loss * (stone > 0.8 * relief)
    once = stone[tuple(places)]
    again = scipy.ndimage.map_coordinates(worn, moved + off)
    errors = noise * rng.standard_normal((2, size, size))
    return [prepared(surface(heights)) for heights in np.array([once, again]) + errors]


def detection_of(pairs):
    first = {patch: once for patch, (once, _) in pairs.items()}
    second = {patch: again for patch, (_, again) in pairs.items()}
    return estimate_detection_limit(first, second, **SEARCH)


def test_repeats_give_the_noise_and_the_lateral_error():
    pairs = {
        "smooth": scanned_twice(1.5e-3, noise=0.1e-3, seed=0),
        "rough": scanned_twice(8e-3, noise=0.1e-3, seed=1),
    }
    detection = detection_of(pairs)
    assert detection.level_mm2**0.5 == pytest.approx(2**0.5 * 0.1e-3, rel=0.05)
    assert detection.lateral_mm2**0.5 == pytest.approx(0.5 * SPACING, rel=0.1)
    assert Detection.from_attrs(detection._asdict() | {"settings": "{}"}) == detection
    assert Detection.from_attrs({"settings": "{}"}) is None


def test_a_measured_level_grows_with_the_slope():
    """On points that are longer along x, and where the registration is unsure along one axis."""
    once, again = (scan.height.values for scan in scanned_twice(5e-3, shift=(0, 0)))
    spacing, errors_mm = (SPACING, 2.5 * SPACING), (1e-3, 0.2e-3)
    change = height_change(
        make_surface(once, spacing),
        make_surface(again, spacing),
        detection=Detection(1e-8, 4e-6, 0.0, 1.96),
        shift_errors_mm=errors_mm,
    )
    expected = 1e-8
    for order, step, error in zip([(1, 0), (0, 1)], spacing, errors_mm, strict=True):
        slope = scipy.ndimage.gaussian_filter(once, 1.0, order=order) / step
        expected = expected + (4e-6 + error**2) * slope**2
    variance = (change["level_of_detection"].values.astype(float) / 1.96) ** 2
    assert_allclose(variance, expected, rtol=1e-6)  # float32
    typical = 1960 * np.median(expected) ** 0.5
    assert change.attrs["level_of_detection_um"] == pytest.approx(typical, rel=1e-6)
    assert change.attrs["lateral_sigma_um"] == pytest.approx(2.0)


STONE = scanned_twice(5e-3, noise=0.0)[0].height


def lines(along, rng):
    """Errors (mm) of scan lines, which correlate over so many points along x."""
    noise = rng.standard_normal((160, 160))
    error = scipy.ndimage.gaussian_filter(noise, (0, along))
    return 0.1e-3 * error / error.std()


@pytest.mark.parametrize(
    ("along", "reach"),
    # neighbours within 2.35 / 2 σ √2 of the kernel on each side err alike, and all of a line that
    # is shifted, as far as a quarter of the field
    [(0.0, 0), (6.0, 18), (1e3, 80)],
)
def test_noise_of_whole_lines_is_no_trace_and_deep_wear_on_it_is(along, reach):
    rng = np.random.default_rng(5)
    once, again = (STONE + lines(along, rng) for _ in "ab")
    change = height_change(once, again, minimum_cluster_points=8)
    summary = wear_summary(change)
    assert max(summary["loss_fraction"], summary["gain_fraction"]) < 0.002
    alike = change.attrs["alike_um2"] / 1.66**2
    assert alike == pytest.approx(reach, rel=0.15, abs=0.1)
    worn = again.copy()
    worn[90:93, 60:63] -= 2e-3
    loss = height_change(once, worn, minimum_cluster_points=8)["loss"]
    assert loss.values[90:93, 60:63].all()


def test_repeats_hand_on_how_their_errors_correlate_and_spread():
    rng = np.random.default_rng(6)
    # a tenth of the points errs three times as much
    tails = 1 + 2 * (rng.random((2, *STONE.shape)) < 0.1)
    pair = [prepared(STONE + lines(6.0, rng) * tail) for tail in tails]
    detection = detection_of({"a": pair})
    assert detection.limit > 2.05
    assert detection.alike_mm2 > 0
    change = height_change(STONE, STONE, detection=detection, minimum_cluster_points=8)
    points = 4 * detection.alike_mm2 / SPACING**2
    assert change.attrs["cluster_points"] == pytest.approx(points, abs=1)
    limit = detection.limit * detection.level_mm2**0.5
    assert change["level_of_detection"].values.min() == pytest.approx(limit, rel=0.05)


def test_a_repeat_that_shows_another_surface_is_not_used(caplog):
    """One that errs as much up as down is used."""
    good, (once, again) = (scanned_twice(5e-3, seed=seed) for seed in (1, 2))
    far = smooth(np.random.default_rng(1), 160, 3)
    far -= far[::-1, ::-1]
    good[1]["height"] += 2e-3 * (abs(far) > 2) * np.sign(far)
    summary = wear_summary(measured_change(*good, **SEARCH))
    assert min(summary["loss_fraction"], summary["gain_fraction"]) > 0.005
    refused = {
        "other": (once, good[1]),
        "worn": scanned_twice(5e-3, seed=2, loss=2e-3),
        "grown": scanned_twice(5e-3, seed=2, loss=-2e-3),
        "deeper": (once, again.assign(height=1.4 * again.height)),
        "unmeasured": (once, prepared(again.height, filled=True)),
    }
    alone = detection_of({"good": good})
    assert alone is not None
    assert caplog.messages == []
    assert detection_of(refused | {"good": good}) == alone
    for patch, message in zip(refused, caplog.messages, strict=True):
        assert f"patch {patch}: its repeat is not used" in message
    assert estimate_detection_limit({}, {}, **SEARCH) is None
