"""One patch, from its maps to its rows: scores, chance, best rival."""

import math

import numpy as np
import pytest
import xarray as xr
from contacts import contact_of
from gstlib.preprocess.leveling import remove_plane
from gstlib.specimen.randomness import self_affine_field, smooth_field
from gstlib.surface import make_surface
from gstlib.validation.change import height_change, wear_summary
from gstlib.validation.nulls import _wrap_around_factors
from gstlib.validation.scores import SCORES
from gstlib.validation.scoring import Chance, Scoring, patch_tables, score_patch, score_table

SETTINGS = {
    "rim": 0.0,
    "neighbourhood_um": 3.0,
    "most_noise": 1.0,
    "seed": 1,
    "shifts": 999,
    "resamples": 199,
}


@pytest.fixture
def patch():
    """A patch that lost height just where contact is predicted, and not at its highest points."""
    rng = np.random.default_rng(3)
    heights = rng.normal(0, 1e-3, (60, 70))
    pressure = np.where(np.arange(4200).reshape(60, 70) % 37 == 0, 5.0, 0.0)
    t0 = make_surface(heights, 1e-3)
    t1 = t0 - 5e-3 * (pressure > 0) + rng.normal(0, 1e-5, heights.shape)
    t1[:, 60:] = np.nan
    return contact_of(t0, pressure, displacement=1e-3), height_change(t0, t1)


def scored(patch, name="7", **changed):
    contact, change = patch
    given = SETTINGS | changed
    scoring, chance = (
        kind(*(given[field] for field in kind._fields)) for kind in (Scoring, Chance)
    )
    return score_patch(name, contact, change, scoring, chance)


def by_score(found):
    return {row["score"]: row for row in found.gains}


def test_perfect_prediction_of_one_patch(patch):
    contact, change = patch
    row = scored(patch).scores
    # noise alone puts about 2.5 % of the rest beyond the level of detection
    assert row["recall"] > 0.5
    assert row["precision"] == 1
    assert row["roc_auc"] > 0.7
    touching = (contact.pressure > 0).values
    assert row["contact_fraction"] == pytest.approx(touching.mean())
    assert row["valid_contact_fraction"] == pytest.approx(touching[:, :60].mean())
    high = contact.height > contact.height.max() - 1e-3
    assert row["rigid_fraction"] == pytest.approx(float(high[:, :60].mean()))
    assert row["noise_share"] == pytest.approx(float(change.gain.sum() / change.loss.sum()))
    assert row["correlation_length_um"] < 1
    assert row["highest_f1"] < 0.3
    assert row["highest_roc_auc"] == pytest.approx(0.5, abs=0.1)


def test_perfect_prediction_is_no_chance_and_beats_its_rivals(patch):
    found = scored(patch)
    rows = by_score(found)
    for name in ("precision", "f1", "mcc", "pr_auc"):
        row = rows[name]
        assert row["shifts"] == 999
        assert row["p_value"] == pytest.approx(1 / (1 + row["shifts"]))
        assert row["effect_size"] > 5
        assert row["null_low"] <= row["null_mean"] <= row["null_high"] < row["value"]
        assert 0 < row["gain_low"] < row["gain"] < row["gain_high"]
        rivals = {rival: found.scores.get(f"{rival}_{name}", -1) for rival in ("highest", "rigid")}
        assert row["best_rival"] == max(rivals, key=rivals.get)
        assert row["best_rival_value"] == max(rivals.values())
        assert row["value"] == found.scores[name]
        assert row["gain"] == pytest.approx(row["value"] - max(rivals.values()), abs=1e-9)
    assert rows["mcc"]["null_mean"] == pytest.approx(0, abs=0.02)


def test_the_highest_points_in_contact_gain_nothing(patch):
    """A model that agrees with its rival gains zero, with an interval of zero."""
    contact, change = patch
    t0 = contact.height
    high = t0.values > np.quantile(t0.values[:, :60], 0.95)
    contact["pressure"] = ("y", "x"), np.where(high, 1 + t0.values * 100, 0)
    contact["gap"] = ("y", "x"), np.where(high, 0, t0.values.max() - t0.values)
    contact["displacement"] = 0.0  # no rigid rival
    found = scored((contact, change))
    assert found.scores["f1"] == pytest.approx(found.scores["highest_f1"])
    for name in ("f1", "roc_auc"):
        row = by_score(found)[name]
        assert row["best_rival"] == "highest"
        assert (row["gain"], row["gain_low"], row["gain_high"]) == pytest.approx((0, 0, 0))


def test_no_interval_from_a_handful_of_blocks(patch, monkeypatch):
    assert by_score(scored(patch))["mcc"]["blocks"] > 9
    monkeypatch.setattr("gstlib.validation.scoring.correlation_length", lambda *_: 0.015)
    few = scored(patch).gains[0]
    assert few["blocks"] == 4
    assert math.isnan(few["gain_low"])
    assert few["gain"] == scored(patch).gains[0]["gain"]


def test_random_numbers_depend_on_seed_and_patch_alone(patch):
    first = repr(scored(patch).gains)
    quick, whole = scored(patch, shifts=0), scored(patch)
    assert math.isnan(quick.scores.pop("correlation_length_um"))  # takes longer than the scores
    assert quick.scores == {name: whole.scores[name] for name in quick.scores}
    assert len(quick.scores) == len(whole.scores) - 1
    assert (quick.gains, quick.null) == ([], {})
    assert repr(scored(patch).gains) == first
    assert repr(scored(patch, seed=2).gains) != first
    assert repr(scored(patch, seed=[1]).gains) == first
    assert repr(scored(patch, name="8").gains).replace("'8'", "'7'") != first


def test_a_patch_without_loss_or_without_known_points_has_no_scores(patch):
    contact, change = patch
    change["loss"] = change["loss"] & False
    rows = by_score(scored((contact, change)))
    assert rows["f1"]["value"] == 0
    assert math.isnan(rows["roc_auc"]["p_value"])
    assert rows["roc_auc"]["best_rival"] == ""
    change["change"] = change["change"] * np.nan
    found = scored((contact, change))
    assert all(math.isnan(row["value"]) and math.isnan(row["p_value"]) for row in found.gains)
    assert math.isnan(found.scores["valid_contact_fraction"])


def test_an_empty_contact_predicts_nothing(patch):
    contact, change = patch
    contact["pressure"] = contact["pressure"] * 0
    contact["gap"] = contact.height.max() - contact.height
    contact["displacement"] = 0.0
    found = scored((contact, change))
    row, rows = found.scores, by_score(found)
    assert (row["contact_fraction"], row["rigid_fraction"], row["recall"], row["f1"]) == (0,) * 4
    assert all(math.isnan(row[name]) for name in ("precision", "mcc", "highest_mcc", "rigid_mcc"))
    assert math.isnan(rows["mcc"]["p_value"])
    assert rows["f1"]["p_value"] == 1


def test_tables_have_the_same_columns_with_and_without_patches(patch):
    found = [scored(patch), scored(patch, name="8")]
    tables, empty = patch_tables(found), patch_tables([])
    for name, rows in {"patches": 2, "gains": 2 * len(SCORES)}.items():
        assert (len(tables[name]), len(empty[name])) == (rows, 0)
        assert list(empty[name]) == list(tables[name])
    assert tables["patches"].notna().all(axis=None)
    # nothing of the rows is lost but what registration.csv states
    told = {*wear_summary(patch[1])} - {"loss_per_area_um"}
    assert {*tables["patches"], *told} == {*found[0].scores}
    assert {*score_table(found)} - {*tables["patches"]} == {"loss_fraction"}


def measured_twice(rng, worn=0.0):
    """Two measurements of one surface; their errors are alike over a few points."""
    stone = 5e-4 * smooth_field(rng, 256, 1.0, 8.0)
    t0, t1 = (make_surface(stone + 1e-4 * smooth_field(rng, 256, 1.0, 3.0), 1e-3) for _ in "01")
    touching = t0.values > np.quantile(t0.values, 0.96)
    t1 -= 1e-3 * (t0.values > np.quantile(t0.values, 1 - worn))
    contact = contact_of(t0, 5.0 * touching, displacement=1e-4)
    return contact, height_change(t0, t1, minimum_points=8)


def test_noise_that_agrees_with_contact_is_not_taken_for_wear():
    def p_values(most_noise):
        rng = np.random.default_rng(5)
        found = [scored(measured_twice(rng), most_noise=most_noise) for _ in range(8)]
        return [by_score(one)["f1"]["p_value"] for one in found]

    # an unworn surface: points that noise raises are in contact, and lower the next time
    assert np.mean(np.array(p_values(np.inf)) <= 0.05) > 0.3
    assert np.isnan(p_values(0.2)).all()
    worn = scored(measured_twice(np.random.default_rng(5), worn=0.05), most_noise=0.2)
    assert 0 < worn.scores["noise_share"] < 0.2
    assert by_score(worn)["f1"]["p_value"] < 0.01
    assert worn.warning is None


@pytest.mark.parametrize(
    ("rose", "fell", "words"),
    [
        (10, 100, []),
        (80, 100, ["80 % as much rose as fell", "minimum_points"]),
        (252, 42, ["far more rose than fell (7 % and 1.2 %", "t0 and t1", "residue"]),
        (252, 0, ["far more rose than fell (7 % and 0 %"]),
        (0, 0, []),
    ],
)
def test_a_patch_that_rose_is_reported_once(patch, rose, fell, words):
    contact, change = patch
    order = np.arange(4200).reshape(70, 60).T  # the valid points first
    spots = {"loss": order < fell, "gain": (order >= fell) & (order < fell + rose)}
    change = change.assign({name: (("y", "x"), mask) for name, mask in spots.items()})
    warning = scored((contact, change), most_noise=0.5, shifts=0).warning
    assert bool(warning) == bool(words)
    assert all(word in warning for word in ["patch 7", *words] if words)


def test_a_mould_undone_wrongly_is_asked_after_first():
    """Heights of both epochs change sign: material removed by use looks added."""
    contact, change = measured_twice(np.random.default_rng(5), worn=0.05)
    t0, t1 = -contact.height, -(contact.height + change.change)
    found = scored((contact.assign(height=t0), height_change(t0, t1, minimum_points=8)))
    assert 0 < found.warning.index("scans.mould.invert") < found.warning.index("t0 and t1")


def test_one_spot_that_misses_is_no_better_than_chance(patch):
    """Nearly all shifts hit nothing, too."""
    contact, change = patch
    pressure = np.zeros(contact.height.shape)
    pressure[:6, :6] = 1.0
    contact["pressure"] = ("y", "x"), pressure
    change["loss"] = change["loss"] & False
    change["loss"][30:36, 30:36] = True
    known = np.isfinite(change.change.values)
    assert _wrap_around_factors([pressure > 0], change.loss.values, known)[0] > 1
    f1 = by_score(scored((contact, change), most_noise=np.inf))["f1"]
    assert (f1["value"], f1["p_value"]) == (0, 1)


@pytest.mark.parametrize(("roll_off", "untested"), [(20.0, ""), (400.0, "long waves")])
def test_loss_in_waves_as_long_as_the_patch_is_not_tested_against_chance(roll_off, untested):
    """Of two unrelated levelled surfaces one is pressed, and the highest of the other is lost."""
    rng = np.random.default_rng(8)

    def levelled():
        wide = self_affine_field(rng, 512, 1.0, hurst_exponent=0.8, roll_off=roll_off)
        return remove_plane(make_surface(wide[:100, :100].astype(float), 1e-3))[0]

    z, other = levelled(), levelled()
    depth = z - z.quantile(0.85)
    contact = contact_of(z, depth.clip(0), (-depth).clip(0), float(depth.max()))
    loss = other > other.quantile(0.75)
    change = xr.Dataset({"change": other, "loss": loss, "gain": loss & False})
    found = scored((contact, change))
    assert {row["untested"] for row in found.gains} == {untested}
    assert {math.isnan(row["p_value"]) for row in found.gains} == {bool(untested)}
    assert bool(found.warning) == bool(untested)
    assert all(word in found.warning for word in ("patch 7", "8 µm", "Larger") if untested)
