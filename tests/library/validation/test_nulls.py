"""The null: exact against brute force, honest where nothing is there, sharp where something is."""

import math

import numpy as np
import pytest
import scipy.ndimage
from scipy.stats import fisher_exact

from gstlib.validation.nulls import (
    correlation_length,
    draw_shifts,
    levels_of,
    p_value,
    shifted_fractions_skill,
    shifted_mask_scores,
    shifted_rank_scores,
)
from gstlib.validation.scores import (
    fractions,
    fractions_skill_of_sums,
    mask_scores,
    rank_scores,
)

SPACING = (2e-3, 2e-3)


def field(rng, length, size=64):
    """A correlated random field, cut out of a larger one: it does not wrap."""
    wide = scipy.ndimage.gaussian_filter(rng.standard_normal((size + 40, size + 40)), length)
    return wide[20:-20, 20:-20]


def top(values, share):
    return values > np.quantile(values, 1 - share)


@pytest.fixture
def case():
    rng = np.random.default_rng(0)
    ranking = field(rng, 2, 30)[:, :27]
    observed = top(field(rng, 3, 30)[:, :27], 0.2)
    valid = np.ones(observed.shape, dtype=bool)
    valid[:4], valid[:, 22:], valid[10, 10] = False, False, False
    shifts = np.array([[0, 0], [1, 0], [0, 26], [17, 5], [29, 13]])
    return ranking, observed, valid, shifts


def test_mask_scores_of_shifts_are_those_of_the_rolled_mask(case):
    ranking, observed, valid, shifts = case
    predicted = top(ranking, 0.1)
    found = shifted_mask_scores(predicted, observed, valid, shifts)
    for place, shift in enumerate(shifts):
        rolled = np.roll(predicted, shift, axis=(0, 1))
        expected = mask_scores(rolled, observed, valid)
        assert {name: values[place] for name, values in found.items()} == pytest.approx(
            expected, nan_ok=True
        )


def test_fractions_skill_of_shifts_is_that_of_the_rolled_shares(case):
    ranking, observed, valid, shifts = case
    p, o = fractions(top(ranking, 0.1), 5), fractions(observed, 5, valid)
    found = shifted_fractions_skill(p, o, valid, shifts)
    for place, shift in enumerate(shifts):
        rolled, seen = np.roll(p, shift, axis=(0, 1))[valid], o[valid]
        expected = fractions_skill_of_sums(rolled @ seen, rolled @ rolled, seen @ seen)
        assert found[place] == pytest.approx(float(expected))


def test_rank_scores_of_shifts_are_those_of_the_rolled_levels(case):
    ranking, observed, valid, shifts = case
    levels = levels_of(ranking, 12)
    found = shifted_rank_scores(levels, observed, valid, shifts)
    for place, shift in enumerate(shifts):
        rolled = -np.roll(levels, shift, axis=(0, 1)).astype(float)
        expected = rank_scores(rolled, observed, valid)
        assert {name: values[place] for name, values in found.items()} == pytest.approx(expected)


def test_levels_keep_the_order_and_are_finer_towards_the_top():
    ranking = np.random.default_rng(1).permutation(10000).reshape(100, 100) * 1.0
    levels = levels_of(ranking, 40)
    order = np.argsort(-ranking.ravel())
    assert (np.diff(levels.ravel()[order]) >= 0).all()
    assert levels.min() == 0
    sizes = np.bincount(levels.ravel())
    assert len(sizes) == pytest.approx(40, abs=1)
    assert sizes[:5].max() < 20 < 200 < sizes[-5:].min()
    # what is tied has one level
    assert len(np.unique(levels_of(np.round(ranking / 2500), 40))) == 5


def test_correlation_length_of_a_known_field():
    """Smoothed white noise has the autocorrelation exp(-r²/4s²): 1/e at twice the smoothing."""
    rng = np.random.default_rng(2)
    valid = rng.random((400, 400)) < 0.9
    found = correlation_length(field(rng, 6, 400), valid, SPACING)
    assert found == pytest.approx(2 * 6 * SPACING[0], rel=0.1)


def test_correlation_length_where_there_is_none():
    valid = np.ones((20, 20), dtype=bool)
    assert math.isnan(correlation_length(np.ones((20, 20)), valid, SPACING))
    assert math.isnan(correlation_length(np.eye(20), ~valid, SPACING))
    white = correlation_length(
        np.random.default_rng(3).random((64, 64)), valid=np.ones((64, 64)), spacing=SPACING
    )
    assert white < SPACING[0]


def test_shifts_are_far_different_and_as_many_as_asked():
    rng = np.random.default_rng(4)
    shifts = draw_shifts((50, 60), (2e-3, 1e-3), beyond=12e-3, count=999, generator=rng)
    assert len(np.unique(shifts, axis=0)) == 999
    y, x = np.minimum(shifts, np.array([50, 60]) - shifts).T
    assert np.hypot(y * 2e-3, x * 1e-3).min() > 12e-3
    near = draw_shifts((50, 60), (2e-3, 1e-3), beyond=45e-3, count=999, generator=rng)
    assert 0 < len(near) < 999
    assert not len(draw_shifts((50, 60), (2e-3, 1e-3), beyond=1.0, count=999, generator=rng))


def test_p_value_counts_the_value_itself_and_ties():
    null = np.array([0.1, 0.2, 0.3, math.nan])
    assert p_value(0.25, null) == 2 / 4
    assert p_value(0.3, null) == 2 / 4
    assert p_value(9.0, null) == 1 / 4
    assert math.isnan(p_value(math.nan, null))
    assert math.isnan(p_value(0.1, np.array([math.nan])))


def p_values(rng, length, seen_length):
    """P-values of independent fields: of F1, of PR-AUC, and one that takes points as trials."""
    ranking, seen = field(rng, length), field(rng, seen_length)
    predicted, observed = top(ranking, 0.08), top(seen, 0.15)
    valid = np.ones(observed.shape, dtype=bool)
    valid[:6], valid[:, 57:] = False, False
    shifts = draw_shifts(
        valid.shape,
        SPACING,
        beyond=correlation_length(observed, valid, SPACING),
        count=999,
        generator=rng,
    )
    shifts = np.vstack([[0, 0], shifts])
    f1 = shifted_mask_scores(predicted, observed, valid, shifts)["f1"]
    pr = shifted_rank_scores(levels_of(ranking, 12), observed, valid, shifts)["pr_auc"]
    cells = [
        [(valid & one & other).sum() for other in (observed, ~observed)]
        for one in (predicted, ~predicted)
    ]
    naive = fisher_exact(cells, alternative="greater").pvalue
    return [*(p_value(score[0], score[1:]) for score in (f1, pr)), naive]


@pytest.mark.parametrize("lengths", [(1.5, 3.0), (3.0, 3.0)])
def test_nothing_is_found_where_nothing_is_as_often_as_the_level_says(lengths):
    rng = np.random.default_rng(5)
    drawn = np.array([p_values(rng, *lengths) for _ in range(200)])
    for level in (0.05, 0.2):
        error = 3 * math.sqrt(level * (1 - level) / len(drawn))
        shares = (drawn[:, :2] <= level).mean(axis=0)
        assert shares == pytest.approx([level, level], abs=error)
    # points taken for independent trials: false alarms many times as often
    assert (drawn[:, 2] <= 0.05).mean() > 4 * 0.05


def test_what_is_there_is_found():
    rng = np.random.default_rng(6)
    common = field(rng, 3)
    noise = field(rng, 1.5)
    predicted = top(common + 0.5 * common.std() / noise.std() * noise, 0.08)
    observed = top(common, 0.15)
    valid = np.ones(observed.shape, dtype=bool)
    shifts = draw_shifts(valid.shape, SPACING, beyond=0.012, count=999, generator=rng)
    scores = shifted_mask_scores(predicted, observed, valid, np.vstack([[0, 0], shifts]))["f1"]
    assert p_value(scores[0], scores[1:]) < 0.01
