"""Intervals hold the truth, and tests claim what is not there, about as often as they say."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

from gstlib.validation.inference import (
    Draws,
    exchange_p_value,
    mean_of,
    percentile_interval,
    rank_correlation,
    spatial_p_value,
)

SIDE = 5
PLACES = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
LEVEL, PAIRS = 0.05, 400


def draws(seed=0, resamples=599):
    return Draws(np.random.default_rng(seed), resamples)


@pytest.mark.parametrize("units", [6, 13])
def test_interval_of_a_mean_of_few_holds_it_as_often_as_it_says(units):
    drawn, repeats = draws(2), 1000
    held = 0
    for _ in range(repeats):
        estimate = mean_of(drawn.generator.standard_normal(units), drawn)
        held += estimate.low <= 0 <= estimate.high
    # at a nominal 95 %, six patches have 93; plain percentiles have less than 91
    assert held / repeats > 0.93 - 2.5 * np.sqrt(0.93 * 0.07 / repeats)


def test_no_interval_of_a_few_or_of_nothing():
    """Three patches that all gain slightly prove nothing: so does one study in four by chance."""
    assert np.isnan(percentile_interval(np.array([0.1, 0.2, 0.3]), 5)).all()
    assert np.isnan(percentile_interval(np.array([np.nan, np.nan]), 9)).all()
    assert math.isnan(mean_of(np.zeros(0), draws()).value)


def test_exchanging_model_and_baseline_is_exact_for_few_patches():
    gain = np.array([0.1, 0.2, 0.15, 0.05, 0.3])
    for gains in (gain, -gain, gain[:2]):
        expected = pytest.approx(2 / 2**gains.size)
        assert exchange_p_value(gains, draws().generator) == expected
    for nothing in (gain[:1], np.zeros(5)):
        assert math.isnan(exchange_p_value(nothing, draws().generator))


def test_rank_correlation_is_spearmans_and_its_permutations_are_exact():
    rng = np.random.default_rng(0)
    table = pd.DataFrame({"x": rng.permutation(8), "y": rng.random(8).round(1)})
    table = table.assign(same=np.exp(table.x), constant=0.1, x_mm=range(8), y_mm=0.0)
    tied = rank_correlation(table, "x", "y", draws())
    assert tied.value == pytest.approx(spearmanr(table.x, table.y).statistic)
    estimate = rank_correlation(table, "x", "same", draws())
    # 2 of the 8! pairings are as extreme
    assert (estimate.low, estimate.p_value) == pytest.approx((1, 2 / math.factorial(8)))
    five = rank_correlation(table[:5], "x", "y", draws())
    assert np.isfinite(five.value)
    assert np.isnan(five.low)
    for few, column in ((2, "x"), (8, "constant")):
        estimate = rank_correlation(table[:few], column, "y", draws())
        assert np.isnan(estimate.value)


def fields(length, seed):
    """Gaussian fields on the patches, correlated over `length`: (PAIRS, 2, patches)."""
    distance = np.hypot(*(PLACES[:, None] - PLACES).transpose(2, 0, 1))
    covariance = np.exp(-((distance / length) ** 2)) + 1e-9 * np.eye(len(PLACES))
    independent = np.random.default_rng(seed).standard_normal((PAIRS, 2, len(PLACES)))
    return independent @ np.linalg.cholesky(covariance).T


def test_smooth_unrelated_fields_are_significant_as_often_as_the_level_says():
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / PAIRS)
    plain, spatial = [], []
    for x, y in fields(1.2, seed=1):
        plain.append(spearmanr(x, y).pvalue)
        spatial.append(spatial_p_value(x, y, PLACES, permuted=plain[-1]))
    assert (
        np.mean(np.less_equal(plain, LEVEL)) > LEVEL + error
    )  # neighbours pass for evidence
    assert abs(np.mean(np.less_equal(spatial, LEVEL)) - LEVEL) < error


def test_patches_at_one_place_are_as_alike_as_close_ones():
    along = np.repeat(np.arange(12.0), 2)
    rng = np.random.default_rng(0)
    x, y = np.sin(along / 4) + [[0.05], [0.3]] * rng.standard_normal((2, 24))
    together, close = (
        spatial_p_value(x, y, np.stack([along + by, 0 * along], 1), permuted=1e-4)
        for by in (0.0, 0.01 * (np.arange(24) % 2))
    )
    assert together == pytest.approx(close, rel=0.1)


def test_the_permutation_test_bounds_the_spatial_p_value():
    x = fields(1.0, seed=4)[0, 0]
    assert spatial_p_value(x, np.exp(x), PLACES, permuted=1e-9) == 1e-9
    nearly = x + 0.1 * np.sin(9 * np.arange(x.size))
    alone = spatial_p_value(x, nearly, PLACES, permuted=0.0)
    assert 0 < alone < 0.5 == spatial_p_value(x, nearly, PLACES, permuted=0.5)
    three = np.arange(3.0)
    assert np.isnan(spatial_p_value(three, three, PLACES[:3], permuted=1.0))
