"""Intervals contain the truth about as often as they claim, within a patch and over patches."""

import numpy as np
import pytest
import scipy.ndimage
from gstlib.validation.intervals import label_blocks, percentile_interval, resampled_scores
from gstlib.validation.scores import Comparison, Prediction, scores_of, window_shares

SPACING = (2e-3, 2e-3)


def field(rng, length, size):
    wide = scipy.ndimage.gaussian_filter(rng.standard_normal((size + 40, size + 40)), length)
    return wide[20:-20, 20:-20] * 2 * np.sqrt(np.pi) * length  # unit variance


def guess(ranking, threshold=1.3):
    mask = ranking > threshold
    return Prediction(mask, window_shares(mask, 3, np.ones_like(mask)), ranking)


def compared(loss, valid):
    return Comparison({}, loss & valid, valid, window_shares(loss, 3, valid), SPACING)


def draw(count, resamples, rng):
    return rng.multinomial(count, np.full(count, 1 / count), size=resamples)


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
    assert label_blocks(valid, SPACING, np.nan)[1] == 20
    assert label_blocks(~valid, SPACING, 1.0)[1] == 0
    # but never so many that the resamples of a large scan would not fit into memory
    large = np.ones((500, 500), dtype=bool)
    assert label_blocks(large, SPACING, 1e-3)[1] == 32**2


def test_resampled_scores_are_those_of_the_repeated_points():
    rng = np.random.default_rng(0)
    ranking = np.round(field(rng, 1.5, 30), 1)
    observed = field(rng, 2, 30) > 0.8
    valid = rng.random(observed.shape) < 0.9
    labels, count = label_blocks(valid, SPACING, 19e-3)
    drawn = draw(count, 3, rng)
    prediction, at = guess(ranking, 0.5), compared(observed, valid)
    found = resampled_scores(prediction, at, labels, drawn)
    for row, times in enumerate([np.ones(count, dtype=int), *drawn]):
        points = np.repeat(np.flatnonzero(valid), times[labels[valid]])
        repeated = Prediction(*(of.ravel()[points][None] for of in vars(prediction).values()))
        loss, there = observed.ravel()[points][None], np.ones((1, points.size), dtype=bool)
        shares = at.loss_shares.ravel()[points][None]
        expected = scores_of(repeated, Comparison({}, loss, there, shares, SPACING))
        for name, value in expected.items():
            close = 0.01 if name.endswith("auc") else 1e-9  # ranks are in levels
            assert found[name][row] == pytest.approx(value, abs=close)


def at_least(rate, trials):
    """The least rate found in so many trials, by 2.5 standard errors, where it is truly `rate`."""
    return rate - 2.5 * np.sqrt(rate * (1 - rate) / trials)


def gains(rng, size, block, resamples, length=2.5):
    """Gains of one guess of the loss over a looser one: (scores, resamples), and the blocks."""
    loss, close, loose = (field(rng, length, size) for _ in range(3))
    at = compared(loss > 1, np.ones(loss.shape, dtype=bool))
    labels, count = label_blocks(at.valid, SPACING, block)
    drawn = draw(count, resamples, rng)
    one, other = (
        resampled_scores(guess(ranking), at, labels, drawn)
        for ranking in (0.85 * loss + 0.53 * close, 0.6 * loss + 0.8 * loose)
    )
    return {name: one[name] - other[name] for name in ("mcc", "pr_auc")}, count


def test_interval_of_a_gain_holds_the_true_gain_as_often_as_it_says():
    rng = np.random.default_rng(1)
    repeats = 80
    truth = {name: values[0] for name, values in gains(rng, 700, 10.0, 0)[0].items()}
    # twice the correlation length, or two points
    lengths = {"blocks": 2 * 2 * 2.5 * SPACING[0], "points": 2 * SPACING[0]}
    held = {(name, kind): 0 for name in truth for kind in lengths}
    for _ in range(repeats):
        for kind, block in lengths.items():
            found, count = gains(rng, 80, block, 199)
            for name, values in found.items():
                low, high = percentile_interval(values[1:], count)
                held[name, kind] += low <= truth[name] <= high
    for name in truth:
        assert truth[name] > 0.1
        # at a nominal 95 %, a bootstrap of a few dozen blocks holds it in nine of ten cases
        assert held[name, "blocks"] / repeats > at_least(0.90, repeats)
        assert held[name, "points"] / repeats < 0.75


@pytest.mark.parametrize("units", [6, 8, 13])
def test_interval_of_a_mean_of_few_holds_it_as_often_as_it_says(units):
    rng = np.random.default_rng(2)
    held = 0
    repeats = 1000
    for _ in range(repeats):
        values = rng.standard_normal(units)
        means = values[rng.integers(0, units, (599, units))].mean(axis=1)
        low, high = percentile_interval(means, units)
        held += low <= 0 <= high
    # at a nominal 95 %, six patches have 93; plain percentiles have less than 91
    assert held / repeats > at_least(0.93, repeats)


def test_no_interval_of_a_few_or_of_nothing():
    """Three patches that all gain slightly prove nothing: so does one study in four by chance."""
    assert np.isnan(percentile_interval(np.array([0.1, 0.2, 0.3]), 5)).all()
    assert np.isnan(percentile_interval(np.array([np.nan, np.nan]), 9)).all()
