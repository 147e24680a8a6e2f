"""The null model: exact against brute force, nominal without a relation, sharp with one."""

import math

import numpy as np
import pytest
import scipy.ndimage
from gstlib.specimen.randomness import smooth_field
from gstlib.validation.agreement import mask_counts, mask_scores
from gstlib.validation.nulls import _wrap_around_factor, correlation_length, p_value, shifted_mcc

SPACING = (2e-3, 2e-3)


def field(rng, length, size=64):
    """A correlated random field, cut out of a larger one: it does not wrap."""
    wide = scipy.ndimage.gaussian_filter(rng.standard_normal((size + 40, size + 40)), length)
    return wide[20:-20, 20:-20]


def top(values, share):
    return values > np.quantile(values, 1 - share)


def nulls(mask, observed, valid, shifts=999, seed=0):
    loss = observed & valid
    return shifted_mcc(
        mask,
        loss,
        valid,
        SPACING,
        beyond_mm=correlation_length(loss, valid, SPACING),
        shifts=shifts,
        generator=np.random.default_rng(seed),
    )


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_scores_of_shifts_are_those_of_the_rolled_prediction(monkeypatch, factor):
    """Over all shifts beyond the correlation length; those above their mean are stretched from it.

    Where most shifts hit nothing, a patch that hits nothing either is no better.
    """
    monkeypatch.setattr("gstlib.validation.nulls._wrap_around_factor", lambda *_: factor)
    rng = np.random.default_rng(0)
    mask, observed = top(field(rng, 2, 30)[:, :27], 0.1), top(field(rng, 3, 30)[:, :27], 0.2)
    valid = np.ones(observed.shape, dtype=bool)
    valid[:4], valid[:, 22:], valid[10, 10] = False, False, False
    found = nulls(mask, observed, valid, 10**6)
    length = correlation_length(observed & valid, valid, SPACING)
    places = [
        (y, x)
        for y in range(30)
        for x in range(27)
        if np.hypot(min(y, 30 - y), min(x, 27 - x)) * SPACING[0] > length
    ]
    assert 0 < len(places) < 30 * 27 - 9
    rolled = [np.roll(mask, place, (0, 1)) for place in [(0, 0), *places]]
    counts = [mask_counts(one, observed, valid) for one in rolled]
    expected = mask_scores(*np.transpose(counts))["mcc"]
    above = np.maximum(expected[1:] - expected[1:].mean(), 0)
    expected[1:] += (factor - 1) * above
    np.testing.assert_allclose(found, expected)


def test_correlation_length_of_a_known_field():
    """Smoothed white noise has the autocorrelation exp(-r²/4s²): 1/e at twice the smoothing."""
    rng = np.random.default_rng(2)
    valid = rng.random((400, 400)) < 0.9
    found = correlation_length(field(rng, 6, 400), valid, SPACING)
    assert found == pytest.approx(2 * 6 * SPACING[0], rel=0.1)


def test_correlation_length_where_there_is_none():
    valid = np.ones((64, 64), dtype=bool)
    assert math.isnan(correlation_length(np.ones((64, 64)), valid, SPACING))
    assert math.isnan(correlation_length(np.eye(64), ~valid, SPACING))
    white = np.random.default_rng(3).random((64, 64))
    assert correlation_length(white, valid, SPACING) < SPACING[0]
    assert correlation_length(np.arange(64)[:, None] + 0 * white, valid, SPACING) > 15 * SPACING[0]


def test_shifts_are_different_and_as_many_as_asked():
    rng = np.random.default_rng(4)
    mask, loss = top(field(rng, 2), 0.1), top(field(rng, 3), 0.2)
    valid = np.ones((64, 64), dtype=bool)
    assert len(nulls(mask, loss, valid)) == 1000
    far = {"beyond_mm": 1.0, "shifts": 999, "generator": rng}
    assert len(shifted_mcc(mask, loss, valid, SPACING, **far)) == 1


def test_p_value_counts_the_value_itself_and_ties():
    null = np.array([0.1, 0.2, 0.3, math.nan])
    assert p_value(0.25, null) == 2 / 4
    assert p_value(0.3, null) == 2 / 4
    assert p_value(9.0, null) == 1 / 4
    assert math.isnan(p_value(math.nan, null))
    assert math.isnan(p_value(0.1, np.array([math.nan])))


@pytest.mark.parametrize("lengths", [(1.5, 3.0), (3.0, 3.0)])
def test_unrelated_fields_are_significant_as_often_as_the_level_says(lengths):
    rng = np.random.default_rng(5)
    valid = np.ones((64, 64), dtype=bool)
    valid[:6], valid[:, 57:] = False, False
    drawn = []
    for _ in range(200):
        mask, loss = top(field(rng, lengths[0]), 0.08), top(field(rng, lengths[1]), 0.15)
        null = nulls(mask, loss, valid, seed=len(drawn))
        drawn.append(p_value(null[0], null[1:]))
    for level in (0.05, 0.2):
        error = 3 * math.sqrt(level * (1 - level) / len(drawn))
        assert (np.array(drawn) <= level).mean() == pytest.approx(level, abs=error)


def test_a_relation_is_found():
    rng = np.random.default_rng(6)
    common, noise = field(rng, 3), field(rng, 1.5)
    ranking = common + 0.5 * common.std() / noise.std() * noise
    every = np.ones(common.shape, dtype=bool)
    null = nulls(top(ranking, 0.1), top(common, 0.15), every)
    assert p_value(null[0], null[1:]) < 0.01


SIDE, LEVEL = 48, 0.05


def smooth_pairs(pairs, length):
    """P-values of two unrelated smooth fields on a window, plain and with the correction."""
    valid = np.ones((SIDE, SIDE), dtype=bool)
    found = []
    for number in range(pairs):
        moved, other = (
            smooth_field(np.random.default_rng([number, k]), 4 * SIDE, 1.0, length)[:SIDE, :SIDE]
            for k in range(2)
        )
        fixed = (other > np.quantile(other, 0.8)).astype(float)
        sums = np.fft.irfft2(np.conj(np.fft.rfft2(moved)) * np.fft.rfft2(fixed), moved.shape)
        factor = _wrap_around_factor(moved, fixed, valid)
        apart = sums.mean() + factor * (sums - sums.mean())
        found.append([(values >= sums[0, 0] - 1e-9).mean() for values in (sums, apart)])
    return np.array(found)


def test_wrap_around_makes_false_alarms_and_the_correction_removes_them():
    pairs = 500
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / pairs)
    plain, corrected = (smooth_pairs(pairs, 20.0) <= LEVEL).mean(axis=0)
    assert plain > LEVEL + error
    assert corrected < LEVEL + error


def test_short_waves_and_constant_fields_need_no_correction():
    rng = np.random.default_rng(1)
    moved, fixed = (rng.random((SIDE, SIDE)) > 0.9 for _ in range(2))
    every = np.ones((SIDE, SIDE), dtype=bool)
    assert _wrap_around_factor(moved, fixed, every) == pytest.approx(1, abs=0.1)
    assert _wrap_around_factor(every, every, every) == 1
    assert _wrap_around_factor(moved, fixed, ~every) == 1
