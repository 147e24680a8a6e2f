"""Scores by hand, against brute force, and their invariants."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gstlib.validation.scores import (
    average_precision,
    fractions,
    fractions_skill,
    mask_scores,
    rank_scores,
    roc_auc,
)

masks = arrays(bool, (4, 5))
levels = arrays(np.int64, 15, elements=st.integers(0, 4))


def test_scores_by_hand():
    predicted = np.array([1, 1, 1, 0, 0, 0, 0, 1], dtype=bool)
    observed = np.array([1, 1, 0, 1, 1, 0, 0, 1], dtype=bool)
    valid = np.array([1, 1, 1, 1, 1, 1, 1, 0], dtype=bool)
    scores = mask_scores(predicted, observed, valid)
    expected = {"precision": 2 / 3, "recall": 2 / 4, "f1": 4 / 7, "iou": 2 / 5}
    expected["mcc"] = (2 * 2 - 1 * 2) / math.sqrt(3 * 4 * 3 * 4)
    assert scores == pytest.approx(expected)


def test_empty_masks():
    none, some = np.zeros(6, dtype=bool), np.arange(6) < 2
    both = mask_scores(none, none)
    assert all(math.isnan(value) for value in both.values())
    silent = mask_scores(none, some)
    assert math.isnan(silent["precision"])
    assert math.isnan(silent["mcc"])
    assert (silent["recall"], silent["f1"], silent["iou"]) == (0, 0, 0)
    alarm = mask_scores(some, none)
    assert math.isnan(alarm["recall"])
    assert (alarm["precision"], alarm["f1"], alarm["iou"]) == (0, 0, 0)
    assert all(math.isnan(v) for v in mask_scores(some, some, none).values())


@settings(deadline=None)
@given(masks, masks, masks)
def test_scores_are_bounded_and_ordered(predicted, observed, valid):
    scores = mask_scores(predicted, observed, valid)
    for name, value in scores.items():
        assert math.isnan(value) or (-1 if name == "mcc" else 0) <= value <= 1
    if not math.isnan(scores["f1"]):
        assert scores["f1"] == pytest.approx(2 * scores["iou"] / (1 + scores["iou"]))


@settings(deadline=None)
@given(masks, masks)
def test_swapping_masks_swaps_precision_and_recall(predicted, observed):
    one, other = mask_scores(predicted, observed), mask_scores(observed, predicted)
    np.testing.assert_equal(one["precision"], other["recall"])
    for name in ("f1", "iou", "mcc"):
        np.testing.assert_allclose(one[name], other[name])


@settings(deadline=None)
@given(masks, masks)
def test_mcc_is_the_correlation_of_the_masks(predicted, observed):
    mcc = mask_scores(predicted, observed)["mcc"]
    if 0 < predicted.sum() < 20 and 0 < observed.sum() < 20:
        expected = np.corrcoef(predicted.ravel(), observed.ravel())[0, 1]
        assert mcc == pytest.approx(expected)
        assert mask_scores(~predicted, observed)["mcc"] == pytest.approx(-mcc)
    else:
        assert math.isnan(mcc)


@settings(deadline=None)
@given(masks, masks, st.permutations(range(20)))
def test_order_of_points_does_not_matter(predicted, observed, order):
    one = mask_scores(predicted, observed)
    other = mask_scores(predicted.ravel()[order], observed.ravel()[order])
    np.testing.assert_equal(one, other)


@settings(deadline=None)
@given(levels, arrays(bool, 15))
def test_roc_auc_against_brute_force(score, observed):
    pairs = [(a > b) + 0.5 * (a == b) for a in score[observed] for b in score[~observed]]
    expected = np.mean(pairs) if pairs else math.nan
    assert roc_auc(score, observed) == pytest.approx(expected, nan_ok=True)


@settings(deadline=None)
@given(arrays(np.int64, 15, elements=st.integers(-9, 9)), arrays(bool, 15))
def test_roc_auc_of_the_reverse_is_the_complement(score, observed):
    assert roc_auc(-score, observed) == pytest.approx(1 - roc_auc(score, observed), nan_ok=True)
    assert roc_auc(np.exp(score), observed) == pytest.approx(roc_auc(score, observed), nan_ok=True)


@settings(deadline=None)
@given(levels, arrays(bool, 15))
def test_average_precision_against_brute_force(score, observed):
    """The mean, over the events, of the precision when all that scores as high is marked."""
    expected = [observed[score >= mark].mean() for mark in score[observed]]
    expected = np.mean(expected) if 0 < observed.sum() < 15 else math.nan
    assert average_precision(score, observed) == pytest.approx(expected, nan_ok=True)


def test_a_score_that_says_nothing_has_the_level_of_chance():
    observed = np.arange(20) < 5
    scores = rank_scores(np.zeros(20), observed)
    assert scores == pytest.approx({"roc_auc": 0.5, "pr_auc": 0.25})


def test_rank_scores_refuse_nan_where_valid():
    score, observed = np.array([1.0, math.nan, 2.0]), np.array([True, False, False])
    with pytest.raises(ValueError, match="NaN"):
        rank_scores(score, observed)
    assert roc_auc(score, observed, np.array([True, False, True])) == 0


def test_fractions_are_shares_of_the_known_part_of_a_window():
    mask = np.zeros((5, 6), dtype=bool)
    mask[1:4, 2] = True
    valid = np.ones_like(mask)
    valid[0], valid[2, 3] = False, False
    shares = fractions(mask, 3, valid)
    for y, x in [(0, 0), (1, 1), (2, 2), (3, 5), (4, 3)]:
        window = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        assert shares[y, x] == pytest.approx((mask & valid)[window].sum() / valid[window].sum())
    with pytest.raises(ValueError, match="odd"):
        fractions(mask, 4)


@settings(deadline=None)
@given(masks, masks, masks)
def test_fractions_skill_of_one_element_is_f1(predicted, observed, valid):
    skill = fractions_skill(predicted, observed, valid, size=1)
    assert skill == pytest.approx(mask_scores(predicted, observed, valid)["f1"], nan_ok=True)


def test_fractions_skill_forgives_a_miss_by_less_than_the_window():
    observed = np.zeros((40, 40), dtype=bool)
    observed[10:14, 10:14] = True
    near, far = np.roll(observed, 4, axis=1), np.roll(observed, 20, axis=1)
    assert fractions_skill(near, observed, size=1) == 0
    wider = [fractions_skill(near, observed, size=size) for size in (3, 5, 9, 15)]
    assert wider == sorted(wider)
    assert wider[-1] > 0.7
    assert fractions_skill(far, observed, size=15) == 0
    assert fractions_skill(observed, observed, size=9) == pytest.approx(1)
