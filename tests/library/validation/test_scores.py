"""Scores by hand, against brute force, and their invariants."""

import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gstlib.surface import make_surface
from gstlib.validation.change import height_change
from gstlib.validation.scores import (
    contact_ranking,
    highest_points,
    mask_scores,
    rank_correlations,
    roc_auc,
    score_patch,
)

masks = arrays(bool, (4, 5))


def test_scores_by_hand():
    predicted = np.array([1, 1, 1, 0, 0, 0, 0, 1], dtype=bool)
    observed = np.array([1, 1, 0, 1, 1, 0, 0, 1], dtype=bool)
    valid = np.array([1, 1, 1, 1, 1, 1, 1, 0], dtype=bool)
    scores = mask_scores(predicted, observed, valid)
    assert scores == pytest.approx({"precision": 2 / 3, "recall": 2 / 4, "f1": 4 / 7, "iou": 2 / 5})


def test_empty_masks():
    none, some = np.zeros(6, dtype=bool), np.arange(6) < 2
    both = mask_scores(none, none)
    assert all(math.isnan(value) for value in both.values())
    silent = mask_scores(none, some)
    assert math.isnan(silent["precision"])
    assert (silent["recall"], silent["f1"], silent["iou"]) == (0, 0, 0)
    alarm = mask_scores(some, none)
    assert math.isnan(alarm["recall"])
    assert (alarm["precision"], alarm["f1"], alarm["iou"]) == (0, 0, 0)
    assert all(math.isnan(v) for v in mask_scores(some, some, none).values())


@settings(deadline=None)
@given(masks, masks, masks)
def test_scores_are_bounded_and_ordered(predicted, observed, valid):
    scores = mask_scores(predicted, observed, valid)
    for value in scores.values():
        assert math.isnan(value) or 0 <= value <= 1
    if not math.isnan(scores["f1"]):
        assert scores["f1"] == pytest.approx(2 * scores["iou"] / (1 + scores["iou"]))


@settings(deadline=None)
@given(masks, masks)
def test_swapping_masks_swaps_precision_and_recall(predicted, observed):
    one, other = mask_scores(predicted, observed), mask_scores(observed, predicted)
    np.testing.assert_equal(one["precision"], other["recall"])
    np.testing.assert_equal([one["f1"], one["iou"]], [other["f1"], other["iou"]])


@settings(deadline=None)
@given(masks, masks, st.permutations(range(20)))
def test_order_of_points_does_not_matter(predicted, observed, order):
    one = mask_scores(predicted, observed)
    other = mask_scores(predicted.ravel()[order], observed.ravel()[order])
    np.testing.assert_equal(one, other)


@settings(deadline=None)
@given(arrays(np.int64, 15, elements=st.integers(0, 4)), arrays(bool, 15))
def test_roc_auc_against_brute_force(score, observed):
    pairs = [(a > b) + 0.5 * (a == b) for a in score[observed] for b in score[~observed]]
    expected = np.mean(pairs) if pairs else math.nan
    assert roc_auc(score, observed) == pytest.approx(expected, nan_ok=True)


@settings(deadline=None)
@given(arrays(np.int64, 15, elements=st.integers(-9, 9)), arrays(bool, 15))
def test_roc_auc_of_the_reverse_is_the_complement(score, observed):
    assert roc_auc(-score, observed) == pytest.approx(1 - roc_auc(score, observed), nan_ok=True)
    assert roc_auc(np.exp(score), observed) == pytest.approx(roc_auc(score, observed), nan_ok=True)


def test_roc_auc_refuses_nan_where_valid():
    score, observed = np.array([1.0, math.nan, 2.0]), np.array([True, False, False])
    with pytest.raises(ValueError, match="NaN"):
        roc_auc(score, observed)
    assert roc_auc(score, observed, np.array([True, False, True])) == 0


@settings(deadline=None)
@given(arrays(np.int64, (4, 5), elements=st.integers(0, 6)), masks, st.data())
def test_highest_points_are_highest_and_as_many(heights, valid, data):
    count = data.draw(st.integers(0, int(valid.sum())))
    mask = highest_points(heights, count, valid)
    assert mask.sum() == count
    assert not (mask & ~valid).any()
    rest = valid & ~mask
    if count and rest.any():
        assert heights[mask].min() >= heights[rest].max()


def test_highest_points_refuses_more_than_there_are():
    with pytest.raises(ValueError, match="7 highest"):
        highest_points(np.zeros((2, 3)), 7)


def test_contact_ranks_above_nearly_touched_above_far():
    order = contact_ranking([0.0, 5.0, 0.0, 1e-9], [1e-3, 0.0, 2e-3, 0.0])
    assert list(np.argsort(order)) == [2, 0, 3, 1]
    assert list(contact_ranking([0.0, 3.0])) == [0, 3]


@pytest.fixture
def patch():
    """A patch that lost height just where contact is predicted, and not at its highest points."""
    rng = np.random.default_rng(3)
    heights = rng.normal(0, 1e-3, (30, 40))
    pressure = np.where(np.arange(1200).reshape(30, 40) % 7 == 0, 5.0, 0.0)
    t0 = make_surface(heights, 1e-3)
    t1 = t0 - 5e-3 * (pressure > 0) + rng.normal(0, 1e-5, heights.shape)
    t1[:, 36:] = np.nan
    contact = xr.Dataset(
        {"pressure": (("y", "x"), pressure), "gap": (("y", "x"), 1e-3 * (pressure == 0))}
    )
    return t0, contact, t1


def test_perfect_prediction_of_one_patch(patch):
    t0, contact, t1 = patch
    row = score_patch(t0, contact, height_change(t0, t1))
    # noise alone puts about 2.5 % of the rest beyond the level of detection
    assert row["recall"] > 0.8
    assert row["precision"] == 1
    assert row["roc_auc"] > 0.9
    assert row["contact_fraction"] == pytest.approx((contact["pressure"] > 0).mean())
    assert row["highest_f1"] < 0.3
    assert row["highest_roc_auc"] == pytest.approx(0.5, abs=0.1)
    assert set(row) >= {"loss_fraction", "loss_volume_um3", "loss_per_area_um"}
    for name in ("precision", "recall", "f1", "iou", "roc_auc"):
        assert {name, f"highest_{name}"} <= set(row)
    assert all(isinstance(value, float) for value in row.values())


def test_prediction_of_another_shape_is_refused(patch):
    t0, contact, t1 = patch
    with pytest.raises(ValueError, match="shapes"):
        score_patch(t0, contact.isel(y=slice(2)), height_change(t0, t1))


def table(seed=0, n=8):
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {
            "pressure_MPa": rng.permutation(n) * 10.0,
            "contact_fraction": rng.random(n),
            "loss_fraction": rng.random(n),
            "loss_per_area_um": rng.random(n),
        }
    )


def test_rank_correlation_of_a_monotone_relation():
    data = table()
    data["loss_fraction"] = np.exp(data["pressure_MPa"] / 30)
    result = rank_correlations(data, generator=np.random.default_rng(0))
    first = result.iloc[0]
    assert list(result.columns) == ["statistic", "value", "low", "high", "p_value", "n"]
    assert first["statistic"] == "spearman(pressure_MPa, loss_fraction)"
    assert first["value"] == pytest.approx(1)
    assert first["n"] == 8
    # exact: 2 of the 8! pairings are as extreme
    assert first["p_value"] == pytest.approx(2 / math.factorial(8))
    assert first["low"] == pytest.approx(1)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 50))
def test_rank_correlation_agrees_with_scipy(seed):
    from scipy.stats import spearmanr

    data = table(seed, n=6)
    result = rank_correlations(data, generator=np.random.default_rng(0), resamples=200)
    expected = spearmanr(data["contact_fraction"], data["loss_per_area_um"]).statistic
    assert result["value"].iloc[3] == pytest.approx(expected)
    assert (result["low"] <= result["high"]).all()
    assert result["p_value"].between(0, 1).all()


def test_interval_lies_around_a_middling_correlation():
    data = table(n=12)
    data["loss_fraction"] = data["pressure_MPa"] + 40 * data["loss_fraction"]
    first = rank_correlations(data, generator=np.random.default_rng(0)).iloc[0]
    assert 0.5 < first["value"] < 0.98
    assert 0 < first["low"] < first["value"] < first["high"] <= 1
    assert 0 < first["p_value"] < 0.05


def test_same_seed_same_table():
    runs = [rank_correlations(table(n=12), generator=np.random.default_rng(5)) for _ in range(2)]
    pd.testing.assert_frame_equal(*runs)
    other = rank_correlations(table(n=12), generator=np.random.default_rng(6))
    assert not other.equals(runs[0])


def test_too_few_or_constant_is_missing_not_wrong():
    data = table()
    data["contact_fraction"] = 0.1
    data.loc[2:, "loss_fraction"] = np.nan
    result = rank_correlations(data, generator=np.random.default_rng(0))
    assert list(result["n"]) == [2, 8, 2, 8]
    assert list(result["value"].isna()) == [True, False, True, True]
