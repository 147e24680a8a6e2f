"""Height change: levelled on what did not wear, with an honest level of detection."""

import numpy as np
import pandas as pd
import pytest
import scipy.ndimage
import xarray as xr
from gstlib.change.change import (
    Detection,
    estimate_detection_limit,
    height_change,
    measured_change,
    wear_summary,
)
from gstlib.change.selection import other_heights, registration_table
from gstlib.macroscale.ensemble import patch_means
from gstlib.study import register_patch
from gstlib.surfaces.footprints import with_t1
from gstlib.surfaces.grid import make_surface, spacing_of
from hypothesis import given, settings
from hypothesis import strategies as st

SPACING = 1.66e-3
SEARCH = {"maximum_shift_mm": 0.1, "minimum_cluster_points": 8}
RULES = {"minimum_overlap": 0.7, "minimum_correlation": 0.5}


def prepared(surface, replaced=False, mask="filled"):
    """A scan as the preparation leaves it, where `replaced` points were not measured."""
    replaced = np.broadcast_to(replaced, surface.shape)
    masks = {name: (("y", "x"), replaced & (name == mask)) for name in ("filled", "outlier")}
    return xr.Dataset({"height": surface} | masks)


def plateau(share, depth, *, noise=0.1e-3, tilt=0.0, seed=0, size=80):
    """T0 and T1 where the first `share` of the rows lost `depth` mm, and the true loss."""
    rng = np.random.default_rng(seed)
    t0 = rng.normal(0, 3e-3, (size, size))
    lost = np.zeros_like(t0, dtype=bool)
    lost[: round(share * size)] = True
    t1 = t0 - depth * lost + rng.normal(0, noise, t0.shape)
    t1 = t1 + tilt * SPACING * np.indices(t0.shape)[1] + 5e-3
    return make_surface(t0, SPACING), make_surface(t1, SPACING), lost


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.45])
def test_wear_of_nearly_half_does_not_pull_the_datum(share):
    t0, t1, lost = plateau(share, 2e-3, tilt=1e-3)
    result = height_change(t0, t1)
    change = result["change"].values
    assert change[~lost].mean() == pytest.approx(0, abs=0.02e-3)
    if lost.any():
        assert change[lost].mean() == pytest.approx(-2e-3, abs=0.02e-3)
        assert (result["loss"].values & lost).sum() > 0.99 * lost.sum()
    assert result.attrs["change_sigma_um"] == pytest.approx(0.1, rel=0.05)
    assert result.attrs["level_of_detection_um"] == pytest.approx(0.196, rel=0.05)


def test_summary_of_a_plateau_by_hand():
    t0, t1, _ = plateau(0.25, 2e-3, noise=1e-9)
    summary = wear_summary(height_change(t0, t1))
    area = 80 * 80 * SPACING**2
    # a fortieth of the unchanged part is noise beyond its own level of detection
    assert summary["loss_fraction"] == pytest.approx(0.25 + 0.75 * 0.025, abs=0.01)
    assert summary["loss_area_mm2"] == pytest.approx(summary["loss_fraction"] * area)
    assert summary["mean_depth_where_worn_um"] == pytest.approx(
        0.5 / summary["loss_fraction"], rel=1e-3
    )
    assert summary["mean_wear_depth_um"] == pytest.approx(0.5, rel=1e-3)
    assert summary["loss_volume_um3"] == pytest.approx(0.25 * area * 1e6 * 2.0, rel=1e-3)


@settings(max_examples=20, deadline=None)
@given(tilt=st.floats(-5e-3, 5e-3), offset=st.floats(-0.1, 0.1), seed=st.integers(0, 100))
def test_datum_and_tilt_of_the_second_measurement_do_not_matter(tilt, offset, seed):
    t0, t1, _ = plateau(0.2, 2e-3, seed=seed, size=40)
    plane = offset + tilt * SPACING * np.indices(t0.shape)[0]
    one, other = height_change(t0, t1), height_change(t0, t1 + plane)
    np.testing.assert_allclose(other["change"], one["change"], atol=0.05e-3)


def bumpy(size=160, *, noise=0.1e-3, seed=0):
    """A smooth surface (mm) whose left half is level and whose right half has steep waves."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((size, size))
    waves = 4e-3 * np.sin(2 * np.pi * y / 20) * np.sin(2 * np.pi * x / 20) * (x >= size / 2)
    return waves, noise * rng.standard_normal((2, size, size))


def test_level_of_detection_is_higher_on_slopes_that_the_registration_misses():
    missed = 0.5  # points, along y
    waves, (noise0, noise1) = bumpy()
    moved = scipy.ndimage.shift(waves, (missed, 0), mode="wrap")
    t0, t1 = make_surface(waves + noise0, SPACING), make_surface(moved + noise1, SPACING)
    result = height_change(t0, t1)
    # along y only: of the squared slope, half counts on the whole, all of it on slopes along y
    assert 0.7 < result.attrs["lateral_sigma_um"] / (missed * SPACING * 1e3) < 1.05
    limit = result["level_of_detection"].values
    assert np.median(limit[:, :80]) < 0.6 * np.median(limit[:, 80:])
    # one value for the patch puts a quarter of the steep half beyond it
    beyond = np.abs(result["change"].values) > limit
    assert beyond[:, 80:].mean() < 0.09
    one_value = np.abs(result["change"].values) > 1.96 * result.attrs["change_sigma_um"] * 1e-3
    assert one_value[:, 80:].mean() > 2 * beyond[:, 80:].mean()
    # where the measurements meet, slopes do not matter
    met = height_change(t0, make_surface(waves + noise1, SPACING))
    assert met.attrs["lateral_sigma_um"] < 0.1
    assert met.attrs["level_of_detection_um"] == pytest.approx(0.196 * np.sqrt(2), rel=0.05)


def test_points_without_two_measured_heights_are_unknown():
    t0, t1, _ = plateau(0.2, 2e-3)
    known = np.ones(t0.shape, dtype=bool)
    known[30:40, 30:40] = False
    spoilt = t0.copy()
    spoilt[30:40, 30:40] += 50e-3
    t1[:, :20] = np.nan
    result = height_change(spoilt, t1, known)
    known[:, :20] = False
    assert np.isnan(result["change"].values[~known]).all()
    np.testing.assert_array_equal(np.isnan(result["t1"]), np.isnan(t1))
    assert not result["loss"].values[~known].any()
    assert result.attrs["known_fraction"] == pytest.approx(1 - 1700 / 6400)
    np.testing.assert_allclose(
        result["change"].values[known], height_change(t0, t1, known)["change"].values[known]
    )


@pytest.mark.parametrize("points", [1, 4, 5, 40])
def test_smaller_spots_are_no_trace(points):
    t0 = make_surface(np.zeros((80, 80)), SPACING)
    change = 1e-6 * np.random.default_rng(1).standard_normal(t0.shape)
    change[10, 10:14] = -1e-3  # four in a row
    change[40, 40] = change[41, 41] = change[42, 40] = change[43, 41] = -1e-3  # corner to corner
    change[60:65, 20:25] = -1e-3
    change[60:62, 60:62] = 1e-3
    result = height_change(t0, t0 + change, minimum_cluster_points=points)
    large = np.abs(change) > 1e-4
    sizes = {1: (33, 4), 4: (33, 4), 5: (25, 0), 40: (0, 0)}[points]
    assert (result["loss"].values & large).sum() == sizes[0]
    assert (result["gain"].values & large).sum() == sizes[1]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_same_scan_twice_shows_no_wear(remeasure, dtype):
    """Laid over itself, it differs by what the arithmetic rounds."""
    t0, _, _ = remeasure((0, 0))
    again = prepared(t0.astype(dtype).astype(float))
    registration, result = measured_change(
        prepared(t0), again, **SEARCH | {"minimum_cluster_points": 1}
    )
    assert registration.found
    summary = wear_summary(result)
    assert (summary["loss_fraction"], summary["gain_fraction"]) == (0, 0)
    assert 1.9e-4 * float(t0.std()) < result.attrs["level_of_detection_um"] < 1e-6


@pytest.mark.parametrize("mask", ["filled", "outlier"])
def test_from_prepared_scans_to_the_change(remeasure, mask):
    t0, t1, truth = remeasure((13.4, -9.7), wear=0.12)
    hole0, hole1 = np.zeros((2, *t0.shape), dtype=bool)
    hole0[100, 100], hole1[150, 150] = True, True
    registration, result = measured_change(
        prepared(t0, hole0, mask), prepared(t1, hole1, mask), **SEARCH
    )
    assert registration.found
    known = np.isfinite(result["change"].values)
    assert not known[100, 100]
    # T1's point lies 13.4 rows further down and 9.7 columns to the left, on T0
    assert not known[163:165, 140:142].any()
    worn, deep = truth < 0, truth < -1e-3
    loss = result["loss"].values & known
    assert (loss & worn).sum() / loss.sum() > 0.98
    assert (loss & deep).sum() / (deep & known).sum() > 0.95
    error = (result["change"].values - truth)[known]
    assert np.median(error) == pytest.approx(0, abs=0.05e-3)
    assert np.median(np.abs(error)) < 0.3e-3


def test_nothing_is_known_of_another_stone(remeasure):
    t0, t1, _ = remeasure((0, 0), other=True)
    registration, result = measured_change(prepared(t0), prepared(t1), **SEARCH)
    assert not registration.found
    assert np.isnan(result["change"]).all()
    assert not result["loss"].any()
    summary = wear_summary(result)
    assert np.isnan(summary["loss_fraction"])
    assert (result.attrs["known_fraction"], summary["loss_area_mm2"]) == (0, 0)


def test_nothing_is_known_where_hardly_a_point_was_measured_at_both_epochs(remeasure, caplog):
    t0, t1, _ = remeasure((0, 0))
    holes0, holes1 = np.zeros((2, *t0.shape), dtype=bool)
    holes0[::2], holes1[1::2] = True, True
    holes1[1, :50] = False  # measured at both
    result = register_patch(prepared(t0, holes0), prepared(t1, holes1), patch="7", **SEARCH)
    assert result.attrs["registration_found"]
    assert result.attrs["known_fraction"] == 0
    assert np.isnan(result["change"]).all()
    assert "patch 7" in caplog.text


def test_the_place_of_t1_is_that_of_the_points_known_at_both_epochs(remeasure):
    """T1 may be smaller or larger than T0, and its coordinates begin elsewhere."""
    t0, t1, _ = remeasure((25, -12), wear=0.05)
    t0 = t0.isel(y=slice(20, 220), x=slice(20, 220))
    size_mm = 200 * float(spacing_of(t0)[0])
    y_mm, x_mm = float(t0.y.mean()), float(t0.x.mean())
    patches = pd.DataFrame({"patch": ["7"], "x_mm": x_mm, "y_mm": y_mm, "rotation_deg": 0.0})
    for rows, columns in ((slice(60, 200), slice(40, None)), (slice(None), slice(None))):
        part = t1.isel(y=rows, x=columns)
        change = register_patch(prepared(t0), prepared(part), patch="7", **SEARCH)
        table = registration_table({"7": change}, RULES, max_gain_to_loss_ratio=0.5)
        weights = patch_means(t0, with_t1(patches, table), size_mm=size_mm).toarray()
        is_covered = weights.reshape(t0.shape) > 0.5 * weights.max()
        is_known = np.isfinite(change.change.values)
        assert (is_covered != is_known).mean() < 0.01
        assert is_known.mean() == pytest.approx(table.overlap[0], abs=0.01)


@pytest.mark.parametrize(
    ("factor", "refused", "warned"),
    [(1.15, 0, 0), (1.4, 0, 1), (0.7, 0, 1), (2.5, 1, 1), (1e-3, 1, 1)],
)
def test_heights_of_another_scale_are_told_from_wear(remeasure, caplog, factor, refused, warned):
    t0, t1, _ = remeasure((20, -10), wear=0.05)
    change = register_patch(prepared(t0), prepared(factor * t1), patch="7", **SEARCH)
    table = registration_table({"7": change}, RULES, max_gain_to_loss_ratio=0.5)
    faults = list(other_heights(table))
    assert len(faults) == refused
    assert all(fault.patches == ("7",) for fault in faults)
    assert sum("calibrated" in message for message in caplog.messages) == warned


# --- The level of detection as repeated scans give it ------------------------------------------


def scanned_twice(relief, *, noise=0.1e-3, scatter=0.5, size=200, seed=0, loss=0.0, shift=(7, -4)):
    """Two prepared scans of a stone with an r.m.s. `relief` (mm), the second laid elsewhere.

    Each point of the second lies off its place by `scatter` (r.m.s. along each axis, points), as
    instruments distort; no shift of the whole map makes up for it.
    """
    rng = np.random.default_rng(seed)

    def smooth(scale):
        field = scipy.ndimage.gaussian_filter(rng.standard_normal((2 * size,) * 2), scale)
        return field / field.std()

    stone, off = relief * smooth(5), [scatter * smooth(4) for _ in range(2)]
    places = np.indices((size, size)) + size // 2
    once = stone[tuple(places)]
    moved = places - np.reshape(shift, (2, 1, 1))
    again = scipy.ndimage.map_coordinates(
        stone - loss * (stone > 0.8 * relief),
        [axis + of[tuple(moved)] for axis, of in zip(moved, off, strict=True)],
    )
    return [
        prepared(make_surface(h + noise * rng.standard_normal(h.shape), SPACING))
        for h in (once, again)
    ]


def split(pairs):
    """The first scans and the second ones, by patch."""
    return [{patch: pair[i] for patch, pair in pairs.items()} for i in (0, 1)]


@pytest.mark.parametrize(("noise", "scatter"), [(0.1e-3, 0.5), (0.2e-3, 0.3), (0.1e-3, 0.0)])
def test_repeats_give_the_noise_and_the_lateral_error(noise, scatter):
    pairs = {
        name: scanned_twice(relief, noise=noise, scatter=scatter, seed=seed)
        for seed, (name, relief) in enumerate({"smooth": 1.5e-3, "rough": 8e-3}.items())
    }
    found = estimate_detection_limit(*split(pairs), **SEARCH)
    assert found.level_mm2**0.5 == pytest.approx(2**0.5 * noise, rel=0.05)
    assert found.lateral_mm2**0.5 == pytest.approx(scatter * SPACING, rel=0.1, abs=0.05 * SPACING)


def test_one_in_twenty_points_of_an_unworn_patch_exceeds_a_measured_level():
    """A patch too small to tell slopes apart finds wear on slopes that it merely misses."""
    pairs = {str(seed): scanned_twice(5e-3, seed=seed) for seed in (1, 2)}
    found = estimate_detection_limit(*split(pairs), **SEARCH)
    shares = {}
    for source, detection in {"own": None, "repeat": found}.items():
        beyond = []
        for seed in range(10, 16):
            once, again = scanned_twice(5e-3, seed=seed, size=30, shift=(0, 0))
            change = height_change(once.height, again.height, detection=detection)
            assert change.attrs["detection"] == source
            dy, dx = np.gradient(once.height.values)
            slope = np.hypot(dy, dx)
            far = np.abs(change["change"].values) > change["level_of_detection"].values
            beyond += [far.mean(), far[slope > np.quantile(slope, 0.75)].mean()]
        shares[source] = np.mean(beyond[::2]), np.mean(beyond[1::2])
    assert shares["repeat"] == pytest.approx((0.05, 0.05), abs=0.02)
    assert shares["own"][1] > 0.10


@pytest.mark.parametrize(("noise", "warned"), [(0.1e-3, 0), (0.15e-3, 0), (0.4e-3, 1)])
def test_a_scan_that_errs_more_than_the_repeats_is_told(caplog, noise, warned):
    found = Detection(2 * (0.1e-3) ** 2, 0.0, 0.0, 1.96)
    epochs = scanned_twice(5e-3, noise=noise, scatter=0.0)
    register_patch(*epochs, patch="7", detection=found, **SEARCH)
    assert sum("error of repeated scans" in message for message in caplog.messages) == warned
    register_patch(*epochs, patch="7", **SEARCH)
    assert len(caplog.messages) == warned


def test_a_measured_level_grows_with_the_slope():
    """On points that are longer along x, and where the registration is unsure along one axis."""
    once, again = (scan.height.values for scan in scanned_twice(5e-3, shift=(0, 0)))
    spacing, errors = (SPACING, 2.5 * SPACING), (1e-3, 0.2e-3)
    found = Detection(1e-8, 4e-6, 0.0, 1.96)
    change = height_change(
        *(make_surface(heights, spacing) for heights in (once, again)),
        detection=found,
        shift_errors_mm=errors,
    )
    variance = (change["level_of_detection"].values.astype(float) / 1.96) ** 2
    dy, dx = (
        scipy.ndimage.gaussian_filter(once, 1.0, order=order) / step
        for order, step in zip(((1, 0), (0, 1)), spacing, strict=True)
    )
    expected = 1e-8 + (4e-6 + errors[0] ** 2) * dy**2 + (4e-6 + errors[1] ** 2) * dx**2
    np.testing.assert_allclose(variance, expected, rtol=1e-6)  # float32
    typical = 1960 * np.median(expected) ** 0.5
    assert change.attrs["level_of_detection_um"] == pytest.approx(typical, rel=1e-6)
    assert change.attrs["lateral_sigma_um"] == pytest.approx(2.0)
    assert change.attrs["detection"] == "repeat"


def lines(size, along, rng, sigma=0.1e-3):
    """Errors (mm) of scan lines, which correlate over so many points along x."""
    error = scipy.ndimage.gaussian_filter1d(rng.standard_normal((size, size)), along, axis=1)
    return sigma * error / error.std()


@pytest.mark.parametrize("along", [0.0, 3.0, 12.0])
def test_noise_of_whole_lines_is_no_trace_and_deep_wear_on_it_is(along):
    rng = np.random.default_rng(5)
    stone = scanned_twice(5e-3, noise=0.0)[0].height
    once, again = (
        stone + lines(200, along, rng) if along else stone + 0.1e-3 * rng.normal(size=stone.shape)
        for _ in "ab"
    )
    change = height_change(once, again, minimum_cluster_points=8)
    summary = wear_summary(change)
    assert max(summary["loss_fraction"], summary["gain_fraction"]) < 0.002
    # neighbours within 2.35 / 2 σ √2 of the kernel on each side err alike
    reach = 2 * np.floor(np.sqrt(4 * np.log(2)) * along)
    assert change.attrs["alike_um2"] == pytest.approx(reach * 1.66**2, rel=0.15, abs=0.1)
    worn = again.copy()
    worn[50:53, 60:63] -= 2e-3
    assert height_change(once, worn, minimum_cluster_points=8)["loss"].values[50:53, 60:63].all()


def test_repeats_hand_on_how_their_errors_correlate_and_spread():
    rng = np.random.default_rng(6)
    stone = scanned_twice(5e-3, noise=0.0)[0].height
    errors = [lines(200, 6.0, rng) * (1 + 2 * (rng.random((200, 200)) < 0.1)) for _ in "ab"]
    detection = estimate_detection_limit(
        *split({"a": [prepared(stone + error) for error in errors]}), **SEARCH
    )
    assert detection.limit > 2.05  # a tenth of the points errs three times as much
    assert detection.alike_mm2 > 0
    change = height_change(stone, stone, detection=detection, minimum_cluster_points=8)
    assert change.attrs["cluster_points"] == pytest.approx(
        4 * detection.alike_mm2 / SPACING**2, abs=1
    )
    limit = 1e3 * detection.limit * detection.level_mm2**0.5
    assert change["level_of_detection"].values.min() * 1e3 == pytest.approx(limit, rel=0.05)


def test_a_repeat_that_shows_another_surface_is_not_used(caplog):
    good = scanned_twice(5e-3, seed=1)
    once, again = scanned_twice(5e-3, seed=2)
    lacks = again.copy(deep=True)
    lacks["filled"][:] = True
    bad = {
        "other": (once, good[1]),
        "worn": scanned_twice(5e-3, seed=2, loss=2e-3),
        "grown": scanned_twice(5e-3, seed=2, loss=-2e-3),
        "deeper": (once, again.assign(height=1.4 * again.height)),
        "shallower": (once, again.assign(height=again.height / 1.4)),
        "deep": (once, again.assign(height=3 * again.height)),
        "lacks": (once, lacks),
    }
    alone = estimate_detection_limit(*split({"good": good}), **SEARCH)
    assert caplog.messages == []
    assert estimate_detection_limit(*split(bad | {"good": good}), **SEARCH) == alone
    for patch, message in zip(bad, caplog.messages, strict=True):
        assert f"patch {patch}: its repeat is not used" in message
    assert estimate_detection_limit(*split(bad), **SEARCH) is None
    assert estimate_detection_limit({}, {}, **SEARCH) is None


def test_a_measured_error_is_read_from_what_was_stored():
    found = Detection(1.25e-8, 3e-9, 1e-5, 2.2)
    assert Detection.of(found._asdict() | {"settings": "{}"}) == found
    assert Detection.of({"settings": "{}"}) is None
