"""Intervals hold the truth about as often as they say, within a patch and over patches."""

import numpy as np
import pytest
import scipy.ndimage

from gstlib.validation.blocks import draw_blocks, label_blocks, resampled_scores
from gstlib.validation.intervals import FEWEST_UNITS, percentile_interval
from gstlib.validation.rivals import Prediction
from gstlib.validation.scores import fractions, fractions_skill, mask_scores, rank_scores

SPACING = (2e-3, 2e-3)


def field(rng, length, size):
    wide = scipy.ndimage.gaussian_filter(rng.standard_normal((size + 40, size + 40)), length)
    return wide[20:-20, 20:-20] * 2 * np.sqrt(np.pi) * length  # unit variance


def guess(ranking, threshold=1.3):
    mask = ranking > threshold
    return Prediction(mask, fractions(mask, 3), ranking)


def test_blocks_divide_the_patch_evenly_and_are_long_enough():
    valid = np.ones((50, 64), dtype=bool)
    valid[:, 40:] = False
    labels, count = label_blocks(valid, (2e-3, 1e-3), 15e-3)
    assert (labels >= 0).tolist() == valid.tolist()
    assert sorted(set(labels[valid])) == list(range(count))
    # 100 mm by 64 in blocks of 15 at least: 6 by 4, of which the last column is not valid
    assert count == 6 * 3
    for number in range(count):
        rows, columns = np.nonzero(labels == number)
        assert 2e-3 * (np.ptp(rows) + 1) >= 15e-3
        assert columns.max() == 39 or 1e-3 * (np.ptp(columns) + 1) >= 15e-3


def test_one_block_at_the_least_and_one_point_at_the_most():
    valid = np.ones((4, 5), dtype=bool)
    assert label_blocks(valid, SPACING, 1.0)[1] == 1
    assert label_blocks(valid, SPACING, 0.0)[1] == 20
    assert label_blocks(~valid, SPACING, 1.0)[1] == 0
    # but never so many that the resamples of a large scan would not fit into memory
    large = np.ones((500, 500), dtype=bool)
    assert label_blocks(large, SPACING, 0.0)[1] == label_blocks(large, SPACING, 1e-3)[1] == 32**2


def test_resampled_scores_are_those_of_the_repeated_points():
    rng = np.random.default_rng(0)
    ranking = np.round(field(rng, 1.5, 30), 1)
    observed = field(rng, 2, 30) > 0.8
    valid = rng.random(observed.shape) < 0.9
    labels, count = label_blocks(valid, SPACING, 19e-3)
    drawn = draw_blocks(count, 3, rng)
    assert (drawn.sum(axis=1) == count).all()
    prediction = guess(ranking, 0.5)
    found = resampled_scores(prediction, observed, fractions(observed, 3, valid), labels, drawn)
    for row, times in enumerate([np.ones(count, dtype=int), *drawn]):
        points = np.repeat(np.flatnonzero(valid), times[labels[valid]])
        expected = mask_scores(prediction.mask.ravel()[points], observed.ravel()[points])
        ranks = rank_scores(ranking.ravel()[points], observed.ravel()[points])
        for name, value in expected.items():
            assert found[name][row] == pytest.approx(value)
        for name, value in ranks.items():  # in levels, and thus not quite
            assert found[name][row] == pytest.approx(value, abs=0.01)
    skill = fractions_skill(prediction.mask, observed, valid, size=3)
    assert found["fss"][0] == pytest.approx(skill)


def test_what_has_no_ranking_has_no_rank_scores():
    mask = np.eye(12, dtype=bool)
    prediction = Prediction(mask, mask.astype(float), None)
    labels, count = label_blocks(~mask | True, SPACING, 0.01)
    found = resampled_scores(prediction, mask, mask, labels, np.ones((2, count), dtype=int))
    assert {"f1", "mcc", "fss"} < set(found)
    assert not {"roc_auc", "pr_auc"} & set(found)


def at_least(rate, trials):
    """The least rate found in so many trials, by 2.5 standard errors, where it is truly `rate`."""
    return rate - 2.5 * np.sqrt(rate * (1 - rate) / trials)


def gain_of(rng, size, length=2.5):
    """A patch whose loss two guesses follow, one more closely; and its loss."""
    loss, close, loose = (field(rng, length, size) for _ in range(3))
    return loss > 1, guess(0.85 * loss + 0.53 * close), guess(0.6 * loss + 0.8 * loose)


def gains(observed, model, rival, labels, drawn):
    shares = fractions(observed, 3)
    one, other = (resampled_scores(p, observed, shares, labels, drawn) for p in (model, rival))
    return {name: one[name] - other[name] for name in ("mcc", "pr_auc")}


def test_interval_of_a_gain_holds_the_true_gain_as_often_as_it_says():
    rng = np.random.default_rng(1)
    size, length, repeats = 80, 2 * 2 * 2.5 * SPACING[0], 80  # twice the correlation length
    large, model, rival = gain_of(rng, 700)
    whole = np.zeros(large.shape, dtype=int)
    truth = {
        name: values[0]
        for name, values in gains(large, model, rival, whole, np.ones((0, 1), dtype=int)).items()
    }
    held = {(name, kind): 0 for name in truth for kind in ("blocks", "points")}
    for _ in range(repeats):
        case = gain_of(rng, size)
        for kind, block in (("blocks", length), ("points", 2 * SPACING[0])):
            labels, count = label_blocks(np.ones((size, size), dtype=bool), SPACING, block)
            found = gains(*case, labels, draw_blocks(count, 199, rng))
            for name, values in found.items():
                low, high = percentile_interval(values[1:], count)
                held[name, kind] += low <= truth[name] <= high
    for name in truth:
        assert truth[name] > 0.1
        # of 95 % asked, a bootstrap of a few dozen blocks holds it in nine of ten cases
        assert held[name, "blocks"] / repeats > at_least(0.90, repeats)
        assert held[name, "points"] / repeats < 0.75


@pytest.mark.parametrize("units", [FEWEST_UNITS, 8, 13])
def test_interval_of_a_mean_of_few_holds_it_as_often_as_it_says(units):
    rng = np.random.default_rng(2)
    held = plain = 0
    repeats = 1000
    for _ in range(repeats):
        values = rng.standard_normal(units)
        means = values[rng.integers(0, units, (599, units))].mean(axis=1)
        low, high = percentile_interval(means, units)
        held += low <= 0 <= high
        plain_low, plain_high = np.quantile(means, [0.025, 0.975])
        plain += plain_low <= 0 <= plain_high
    # of 95 % asked, six patches have 93
    assert held / repeats > at_least(0.93, repeats)
    assert held >= plain
    if units < 13:
        assert plain / repeats < 0.91


def test_no_interval_of_a_few_or_of_nothing():
    """Three patches that all gain a little prove nothing: by chance one study in four has them."""
    assert np.isnan(percentile_interval([0.1, 0.2, 0.3], FEWEST_UNITS - 1)).all()
    assert np.isnan(percentile_interval([np.nan, np.nan], 9)).all()
