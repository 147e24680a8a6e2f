"""Scores by hand, against brute force, and their invariants; and what the rivals mark."""

import math

import numpy as np
import pytest
import xarray as xr
from contacts import contact_of
from gstlib.surface import make_surface
from gstlib.validation.scores import (
    Comparison,
    Prediction,
    compare,
    rank_levels,
    scores_of,
    window_shares,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

masks = arrays(bool, (4, 5))


def scores(predicted, observed, valid=None, *, size=1, ranking=None):
    everywhere = np.ones(observed.shape, dtype=bool)
    valid = everywhere if valid is None else valid
    loss = observed & valid
    shares = window_shares(loss, size, valid)
    guess = Prediction(predicted, window_shares(predicted, size, everywhere), ranking)
    return scores_of(guess, Comparison({}, loss, valid, shares, (1.0, 1.0)))


def test_scores_by_hand():
    predicted = np.array([[1, 1, 1, 0, 0, 0, 0, 1]], dtype=bool)
    observed = np.array([[1, 1, 0, 1, 1, 0, 0, 1]], dtype=bool)
    valid = np.array([[1, 1, 1, 1, 1, 1, 1, 0]], dtype=bool)
    expected = {"precision": 2 / 3, "recall": 2 / 4, "f1": 4 / 7, "fss": 4 / 7}
    expected["mcc"] = (2 * 2 - 1 * 2) / math.sqrt(3 * 4 * 3 * 4)
    assert scores(predicted, observed, valid) == pytest.approx(expected)


def test_empty_masks():
    none, some = np.zeros((2, 3), dtype=bool), np.arange(6).reshape(2, 3) < 2
    for empty in (scores(none, none), scores(some, some, none)):
        assert all(math.isnan(value) for value in empty.values())
    silent, alarm = scores(none, some), scores(some, none)
    assert math.isnan(silent["precision"] + silent["mcc"] + alarm["recall"])
    assert (silent["recall"], silent["f1"]) == (0, 0)
    assert (alarm["precision"], alarm["f1"]) == (0, 0)


@settings(deadline=None)
@given(masks, masks, masks)
def test_masks_may_be_swapped_and_mcc_is_their_correlation(predicted, observed, valid):
    one, other = scores(predicted, observed, valid), scores(observed & valid, predicted, valid)
    np.testing.assert_equal(one["precision"], other["recall"])
    for name in ("f1", "mcc"):
        np.testing.assert_allclose(one[name], other[name])
    # fractions skill of one element is F1
    assert one["fss"] == pytest.approx(one["f1"], nan_ok=True)
    p, o = predicted[valid], observed[valid]
    if 0 < p.sum() < p.size and 0 < o.sum() < o.size:
        assert one["mcc"] == pytest.approx(np.corrcoef(p, o)[0, 1])
    else:
        assert math.isnan(one["mcc"])


@settings(deadline=None)
@given(arrays(np.int64, (1, 15), elements=st.integers(0, 4)), arrays(bool, (1, 15)))
def test_rank_scores_against_brute_force(ranking, observed):
    """Pairs ordered rightly; mean, over the events, of the precision when all as high is marked."""
    pairs = [(a > b) + 0.5 * (a == b) for a in ranking[observed] for b in ranking[~observed]]
    precision = [observed[ranking >= mark].mean() for mark in ranking[observed]]
    both = 0 < observed.sum() < 15
    found = scores(observed, observed, ranking=ranking)
    assert found["roc_auc"] == pytest.approx(np.mean(pairs) if both else math.nan, nan_ok=True)
    assert found["pr_auc"] == pytest.approx(np.mean(precision) if both else math.nan, nan_ok=True)
    # only the order counts
    other = scores(observed, observed, ranking=np.exp(ranking))
    assert other == pytest.approx(found, nan_ok=True)


def test_levels_keep_the_order_and_are_finer_towards_the_top():
    ranking = np.random.default_rng(1).permutation(10000).reshape(100, 100) * 1.0
    level = rank_levels(ranking, 40)
    order = np.argsort(-ranking.ravel())
    assert (np.diff(level.ravel()[order]) >= 0).all()
    assert level.min() == 0
    sizes = np.bincount(level.ravel())
    assert len(sizes) == pytest.approx(40, abs=1)
    assert sizes[:5].max() < 20 < 200 < sizes[-5:].min()
    # ties share a level
    assert len(np.unique(rank_levels(np.round(ranking / 2500), 40))) == 5


def test_window_shares_are_those_of_the_known_part_of_a_window():
    mask = np.zeros((5, 6), dtype=bool)
    mask[1:4, 2] = True
    valid = np.ones_like(mask)
    valid[0], valid[2, 3] = False, False
    shares = window_shares(mask, 3, valid)
    for y, x in [(0, 0), (1, 1), (2, 2), (3, 5), (4, 3)]:
        window = np.s_[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        assert shares[y, x] == pytest.approx((mask & valid)[window].sum() / valid[window].sum())


def test_fractions_skill_forgives_a_miss_by_less_than_the_window():
    observed = np.zeros((40, 40), dtype=bool)
    observed[10:14, 10:14] = True
    near, far = np.roll(observed, 4, axis=1), np.roll(observed, 20, axis=1)
    wider = [scores(near, observed, size=size)["fss"] for size in (1, 3, 5, 9, 15)]
    assert wider == sorted(wider)
    assert wider[0] == 0
    assert wider[-1] > 0.7
    assert scores(far, observed, size=15)["fss"] == 0
    assert scores(observed, observed, size=9)["fss"] == pytest.approx(1)


def compared(heights, pressure, gap, displacement, valid=None, *, neighbourhood_um=0.0):
    heights = make_surface(heights, 1e-3)
    change = np.where(True if valid is None else valid, 0.0, np.nan)
    return compare(
        heights,
        contact_of(heights, pressure, gap, displacement),
        xr.Dataset({"change": heights * 0 + change, "loss": heights < np.inf}),
        neighbourhood_um=neighbourhood_um,
    )


@settings(deadline=None)
@given(arrays(np.int64, (4, 5), elements=st.integers(0, 6)), masks, masks)
def test_the_highest_points_are_highest_and_as_many_as_in_contact(heights, touching, valid):
    mask = compared(heights, 1.0 * touching, -heights, 1, valid).predictions["highest"].mask
    assert mask.sum() == (touching & valid).sum()
    assert not (mask & ~valid).any()
    rest = valid & ~mask
    if mask.any() and rest.any():
        assert heights[mask].min() >= heights[rest].max()
        # of equal heights the first are taken
        level = (heights == heights[mask].min()) & valid
        assert (np.diff(mask[level].astype(int)) <= 0).all()


def test_rigid_interpenetration_is_at_the_same_displacement():
    heights = np.random.default_rng(0).normal(size=(30, 40))
    pressure = np.where(heights > 1.9, 7.0, 0.0)
    found = compared(heights, pressure, -heights, 0.8).predictions
    assert (found["rigid"].mask == (heights.max() - heights < 0.8)).all()
    # at the area of the contact it is the highest points, and it ranks as they do
    assert [name for name, one in found.items() if one.ranking is None] == ["rigid"]
    for count in (1, 17, 300):
        above, below = np.sort(heights.ravel())[[-count, -count - 1]]
        pressure = 1.0 * (np.arange(1200).reshape(30, 40) < count)
        depth = heights.max() - (above + below) / 2
        found = compared(heights, pressure, -heights, depth).predictions
        assert (found["rigid"].mask == found["highest"].mask).all()


def test_contact_ranks_above_nearly_touched_above_far():
    pressure, gap = np.array([[0.0, 5.0, 0.0, 1e-9]]), np.array([[1e-3, 0.0, 2e-3, 0.0]])
    found = compared(np.array([[0.0, 5.0, 0.0, 1.0]]), pressure, gap, 0.1).predictions
    assert np.argsort(found["contact"].ranking[0]).tolist() == [2, 0, 3, 1]


@pytest.mark.parametrize(
    ("length", "width"), [(0.0, 1), (1.9, 1), (2.1, 3), (3.9, 3), (4.1, 5), (21.0, 21)]
)
def test_window_is_the_nearest_odd_number_of_elements(length, width):
    pressure = np.zeros((61, 71))
    pressure[30, 30] = 1.0
    found = compared(pressure, pressure, 1 - pressure, 0.1, neighbourhood_um=length)
    shares = found.predictions["contact"].shares
    assert (shares > 0).sum() == width**2
    assert shares[30, 30] == pytest.approx(1 / width**2)


def test_prediction_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="shapes"):
        compared(np.zeros((4, 5)), np.zeros((4, 4)), np.zeros((4, 4)), 0.1)
