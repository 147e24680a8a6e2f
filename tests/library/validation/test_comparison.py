"""One patch, from its maps to its rows: scores, chance, best rival, and where it fails."""

import dataclasses
import math

import numpy as np
import pytest
import xarray as xr

from gstlib.specimen.randomness import smooth_field
from gstlib.surface import make_surface
from gstlib.validation.change import height_change
from gstlib.validation.comparison import compare, score_patch, scores_of, warning_of
from gstlib.validation.failures import gap_bands, height_bands, split_loss
from gstlib.validation.gains import null_scores, weigh_patch
from gstlib.validation.scores import SCORES
from gstlib.validation.seam import seam_factor

LENGTHS = {"neighbourhood_um": 3.0, "curvature_length_um": 2.0}


@pytest.fixture
def patch():
    """A patch that lost height just where contact is predicted, and not at its highest points."""
    rng = np.random.default_rng(3)
    heights = rng.normal(0, 1e-3, (60, 70))
    pressure = np.where(np.arange(4200).reshape(60, 70) % 37 == 0, 5.0, 0.0)
    t0 = make_surface(heights, 1e-3)
    t1 = t0 - 5e-3 * (pressure > 0) + rng.normal(0, 1e-5, heights.shape)
    t1[:, 60:] = np.nan
    contact = xr.Dataset(
        {
            "pressure": (("y", "x"), pressure),
            "gap": (("y", "x"), 1e-3 * (pressure == 0)),
            "displacement": ("step", [1e-4, 1e-3]),
        }
    )
    return t0, contact, height_change(t0, t1)


def rows_of(patch, *, resamples=199, seed=0, most_noise=1.0, **changed):
    t0, contact, change = patch
    comparison = compare(t0, contact, change, **(LENGTHS | changed))
    scores = scores_of(comparison)
    rng = np.random.default_rng(seed)
    null = null_scores(comparison, shifts=999, generator=rng)
    rows = weigh_patch(
        scores, comparison, null, most_noise=most_noise, resamples=resamples, generator=rng
    )
    return comparison, scores, {row["score"]: row for row in rows}


def test_perfect_prediction_of_one_patch(patch):
    t0, contact, change = patch
    comparison = compare(t0, contact, change, **LENGTHS)
    row = score_patch(comparison, scores_of(comparison), change)
    # noise alone puts about 2.5 % of the rest beyond the level of detection
    assert row["recall"] > 0.5
    assert row["precision"] == 1
    assert row["roc_auc"] > 0.7
    assert row["pr_lift"] == pytest.approx(row["pr_auc"] / row["loss_fraction"])
    assert row["contact_fraction"] == pytest.approx((contact["pressure"] > 0).mean())
    assert row["rigid_fraction"] == pytest.approx(
        float((t0 > t0.max() - 1e-3).values[:, :60].mean())
    )
    assert row["highest_f1"] < 0.3
    assert row["highest_roc_auc"] == pytest.approx(0.5, abs=0.1)
    assert set(row) >= {"loss_fraction", "loss_volume_um3", "loss_per_area_um"}
    for name in SCORES:
        assert {name, f"highest_{name}", f"curvature_{name}"} <= set(row)
        # a rigid flat cuts off the highest points: its ranking is theirs
        assert (f"rigid_{name}" in row) == (name not in ("roc_auc", "pr_auc"))
    assert all(isinstance(value, float) for value in row.values())


def test_perfect_prediction_is_no_chance_and_beats_its_rivals(patch):
    _, scores, rows = rows_of(patch)
    for name in ("precision", "f1", "mcc", "pr_auc"):
        row = rows[name]
        assert row["p_value"] == pytest.approx(1 / (1 + row["shifts"]))
        assert row["effect_size"] > 5
        assert row["null_low"] <= row["null_mean"] <= row["null_high"] < row["value"]
        assert 0 < row["gain_low"] < row["gain"] < row["gain_high"]
        best = max(one[name] for rival, one in scores.items() if rival != "contact" and name in one)
        assert row["best_rival_value"] == best
        assert row["gain"] == pytest.approx(scores["contact"][name] - best, abs=1e-9)
        assert scores[row["best_rival"]][name] == best
    assert rows["mcc"]["null_mean"] == pytest.approx(0, abs=0.02)


def test_the_highest_points_in_contact_gain_nothing(patch):
    """The model that says what its rival says: the gain is zero, and so is its interval."""
    t0, contact, change = patch
    high = t0.values > np.quantile(t0.values[:, :60], 0.95)
    contact["pressure"] = ("y", "x"), np.where(high, 1 + t0.values * 100, 0)
    contact["gap"] = ("y", "x"), np.where(high, 0, t0.values.max() - t0.values)
    _, scores, rows = rows_of((t0, contact, change))
    assert scores["contact"]["f1"] == pytest.approx(scores["highest"]["f1"])
    gain = rows["roc_auc"]
    if gain["best_rival"] == "highest":
        assert (gain["gain"], gain["gain_low"], gain["gain_high"]) == pytest.approx((0, 0, 0))
    assert rows["f1"]["gain"] <= 0


def test_no_interval_from_a_handful_of_blocks(patch):
    comparison, _, rows = rows_of(patch)
    assert rows["mcc"]["blocks"] > 9
    wide = dataclasses.replace(comparison, correlation_length=0.015)
    rng = np.random.default_rng(0)
    null = null_scores(wide, shifts=999, generator=rng)
    few = weigh_patch(scores_of(wide), wide, null, most_noise=1.0, resamples=199, generator=rng)[0]
    assert few["blocks"] == 4
    assert math.isnan(few["gain_low"])
    assert few["gain"] == rows["precision"]["gain"]


def test_same_seed_same_rows(patch):
    assert repr(rows_of(patch)[2]) == repr(rows_of(patch)[2])
    assert repr(rows_of(patch, seed=1)[2]) != repr(rows_of(patch)[2])


def test_a_patch_without_loss_or_without_known_points_has_no_scores(patch):
    t0, contact, change = patch
    change["loss"] = change["loss"] & False
    _, _, rows = rows_of((t0, contact, change))
    assert rows["f1"]["value"] == 0
    assert math.isnan(rows["roc_auc"]["p_value"])
    assert rows["roc_auc"]["best_rival"] == ""
    change["change"] = change["change"] * np.nan
    comparison, scores, rows = rows_of((t0, contact, change))
    assert all(math.isnan(row["value"]) and math.isnan(row["p_value"]) for row in rows.values())
    assert math.isnan(score_patch(comparison, scores, change)["valid_contact_fraction"])


def measured_twice(rng, worn=0.0):
    """Two measurements of one surface; their errors are alike over a few points."""
    stone = 5e-4 * smooth_field(rng, 256, 1.0, 8.0)
    t0, t1 = (make_surface(stone + 1e-4 * smooth_field(rng, 256, 1.0, 3.0), 1e-3) for _ in "01")
    touching = t0.values > np.quantile(t0.values, 0.96)
    t1 -= 1e-3 * (t0.values > np.quantile(t0.values, 1 - worn))
    fields = {"pressure": 5.0 * touching, "gap": 1e-3 * ~touching}
    contact = xr.Dataset({name: (("y", "x"), values) for name, values in fields.items()})
    return t0, contact, height_change(t0, t1, minimum_points=8)


def test_noise_that_agrees_with_contact_is_not_claimed_for_wear():
    def p_values(most_noise):
        rng = np.random.default_rng(5)
        patches = [measured_twice(rng) for _ in range(8)]
        return [rows_of(one, most_noise=most_noise)[2]["f1"]["p_value"] for one in patches]

    # An unworn surface: what is high by error is in contact, and lower the next time.
    assert np.mean(np.array(p_values(np.inf)) <= 0.05) > 0.3
    assert np.isnan(p_values(0.2)).all()
    worn, _, rows = rows_of(measured_twice(np.random.default_rng(5), worn=0.05), most_noise=0.2)
    assert 0 < worn.noise_share < 0.2
    assert rows["f1"]["p_value"] < 0.01


@pytest.mark.parametrize(
    ("rose", "fell", "words"),
    [
        (0.01, 0.05, []),
        (0.04, 0.05, ["80 % as much rose as fell", "minimum_points"]),
        (0.06, 0.01, ["far more rose than fell (6 % and 1 %", "t0 and t1 exchanged", "residue"]),
        (0.06, 0.0, ["far more rose than fell (6 % and 0 %"]),
        (0.0, 0.0, []),
        (np.nan, np.nan, []),  # nothing is known of the change
    ],
)
def test_a_patch_that_rose_is_told_once_and_in_its_own_words(rose, fell, words):
    row = {"patch": "7", "gain_fraction": rose, "loss_fraction": fell}
    told = warning_of(row | {"noise_share": rose / fell if fell else np.nan}, 0.5)
    assert bool(told) == bool(words)
    assert all(word in told for word in words)


def test_prediction_of_another_shape_is_refused(patch):
    t0, contact, change = patch
    with pytest.raises(ValueError, match="shapes"):
        compare(t0, contact.isel(y=slice(2)), change, **LENGTHS)


def test_without_gap_and_displacement_what_needs_them_is_left_out(patch):
    t0, contact, change = patch
    comparison = compare(t0, contact[["pressure"]], change, **LENGTHS)
    assert "rigid" not in scores_of(comparison)
    assert len(np.unique(comparison.predictions["contact"].ranking)) == 2


def test_window_is_the_nearest_odd_number_of_elements(patch):
    t0, contact, change = patch
    contact["pressure"] = ("y", "x"), np.zeros(t0.shape)
    contact["pressure"][30, 30] = 1.0
    for length, width in ((0.0, 1), (1.9, 1), (2.1, 3), (3.9, 3), (4.1, 5), (21.0, 21)):
        comparison = compare(t0, contact, change, **(LENGTHS | {"neighbourhood_um": length}))
        shares = comparison.predictions["contact"].shares
        assert (shares > 0).sum() == width**2
        assert shares[30, 30] == pytest.approx(1 / width**2)


def test_bands_divide_the_known_points_and_the_loss(patch):
    t0, contact, change = patch
    comparison = compare(t0, contact, change, **LENGTHS)
    touching, valid = contact["pressure"].values > 0, comparison.valid
    by_height = height_bands(t0.values, valid, [0.5, 0.9])
    by_gap = gap_bands(touching, np.arange(4200).reshape(60, 70) * 1e-6, valid, [1.0, 3.0])
    assert list(by_height) == ["0-50 %", "50-90 %", "90-100 %"]
    assert list(by_gap) == ["contact", "0-1 um", "1-3 um", "over 3 um"]
    for bands in (by_height, by_gap):
        assert (sum(band.astype(int) for band in bands.values()) == valid).all()
        rows = split_loss(touching, comparison.loss, valid, bands)
        for name in ("area_share", "loss_share"):
            assert sum(row[name] for row in rows) == pytest.approx(1)
        recall = scores_of(comparison)["contact"]["recall"]
        assert sum(row["hit_share"] for row in rows) == pytest.approx(recall)
    lowest, _, highest = by_height.values()
    assert t0.values[lowest].max() < t0.values[highest].min()
    assert lowest.sum() == valid.sum() / 2
    in_contact = split_loss(touching, comparison.loss, valid, by_gap)[0]
    assert in_contact["recall"] == 1


def test_loss_in_valleys_is_seen_as_missed_there():
    heights = np.arange(100.0).reshape(10, 10)
    valid = np.ones((10, 10), dtype=bool)
    loss, predicted = (heights < 30) | (heights >= 90), heights >= 80
    rows = split_loss(predicted, loss, valid, height_bands(heights, valid, [0.5, 0.9]))
    assert [row["recall"] for row in rows] == pytest.approx([0, math.nan, 1], nan_ok=True)
    assert [row["loss_share"] for row in rows] == [0.75, 0, 0.25]
    assert [row["loss_fraction"] for row in rows] == [0.6, 0, 1]


def test_what_hits_nothing_is_no_better_than_shifts_that_hit_nothing(patch):
    """One large spot and one large loss: nearly all shifts hit nothing either."""
    t0, contact, change = patch
    pressure = np.zeros(t0.shape)
    pressure[:12, :12] = 1.0
    contact["pressure"] = ("y", "x"), pressure
    change["loss"] = change["loss"] & False
    change["loss"][30:42, 30:42] = True
    comparison, _, rows = rows_of((t0, contact, change))
    assert seam_factor(pressure > 0, comparison.loss, comparison.valid) > 1
    assert rows["f1"]["value"] == 0
    assert rows["f1"]["p_value"] == 1
