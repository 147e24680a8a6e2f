"""Intervals hold the truth, and tests claim what is not there, about as often as they say."""

import math

import numpy as np
import pandas as pd
import pytest
from gstlib.validation.inference import (
    Draws,
    exchange_p_value,
    mean_of,
    percentile_interval,
    rank_correlation,
    ratio_of_sums,
    spatial_p_value,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

PAIR = "pressure_MPa", "loss_fraction"


def draws(seed=0, resamples=999):
    return Draws(np.random.default_rng(seed), resamples)


def at_least(rate, trials):
    """The least rate found in so many trials, by 2.5 standard errors, where it is truly `rate`."""
    return rate - 2.5 * np.sqrt(rate * (1 - rate) / trials)


@pytest.mark.parametrize("units", [6, 8, 13])
def test_interval_of_a_mean_of_few_holds_it_as_often_as_it_says(units):
    rng = np.random.default_rng(2)
    held = 0
    repeats = 1000
    for _ in range(repeats):
        found = mean_of(rng.standard_normal(units), Draws(rng, 599))
        held += found.low <= 0 <= found.high
    # at a nominal 95 %, six patches have 93; plain percentiles have less than 91
    assert held / repeats > at_least(0.93, repeats)


def test_no_interval_of_a_few_or_of_nothing():
    """Three patches that all gain slightly prove nothing: so does one study in four by chance."""
    assert np.isnan(percentile_interval(np.array([0.1, 0.2, 0.3]), 5)).all()
    assert np.isnan(percentile_interval(np.array([np.nan, np.nan]), 9)).all()
    none = mean_of(np.zeros(0), draws())
    assert none.n == 0
    assert math.isnan(none.value)


def test_a_ratio_is_that_of_the_sums_and_its_interval_resamples_both_together():
    errors = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    found = ratio_of_sums(0.5 * errors, errors, draws())
    assert (found.value, found.low, found.high, found.n) == (0.5, 0.5, 0.5, 6)
    mixed = ratio_of_sums(errors[::-1], errors, draws())
    assert mixed.low < mixed.value == 1 < mixed.high


def test_exchanging_model_and_baseline_is_exact_for_few_patches():
    gain = np.array([0.1, 0.2, 0.15, 0.05, 0.3])
    for of in (gain, -gain, gain[:2]):
        assert exchange_p_value(of, np.random.default_rng(0)) == pytest.approx(2 / 2**of.size)
    for nothing in (gain[:1], np.zeros(5)):
        assert math.isnan(exchange_p_value(nothing, np.random.default_rng(0)))


def table(seed=0, n=8):
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {
            "pressure_MPa": rng.permutation(n) * 10.0,
            "contact_fraction": rng.random(n),
            "loss_fraction": rng.random(n),
            "mean_wear_depth_um": rng.random(n),
        }
    )


def test_rank_correlation_agrees_with_scipy():
    data = table()
    data["mean_wear_depth_um"] = data["mean_wear_depth_um"].round(1)  # with ties
    data["loss_fraction"] = np.exp(data["pressure_MPa"] / 30)
    pair = "contact_fraction", "mean_wear_depth_um"
    tied = rank_correlation(data, *pair, draws(), places=())
    assert tied.value == pytest.approx(spearmanr(*data[[*pair]].to_numpy().T).statistic)
    found = rank_correlation(data, *PAIR, draws(), places=())
    assert (found.value, found.low, found.n) == (pytest.approx(1), pytest.approx(1), 8)
    # exact: 2 of the 8! pairings are as extreme
    assert found.p_value == pytest.approx(2 / math.factorial(8))


@pytest.mark.parametrize(("known", "column"), [(5, "x"), (2, "x"), (8, "constant")])
def test_too_few_or_constant_is_missing_not_wrong(known, column):
    data = table().assign(constant=0.1).rename(columns={"pressure_MPa": "x"})
    data.loc[known:, "loss_fraction"] = np.nan
    found = rank_correlation(data, column, "loss_fraction", draws(), places=())
    assert found.n == known
    assert np.isfinite(found.value) == (known == 5)
    assert np.isnan(found.low)  # of five patches there is a value, but no interval


SIDE = 5
PLACES = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
LEVEL, PAIRS = 0.05, 400


def fields(length, seed):
    """Gaussian fields on the patches, correlated over `length`: (PAIRS, 2, patches)."""
    distance = np.hypot(*(PLACES[:, None] - PLACES).transpose(2, 0, 1))
    factor = np.linalg.cholesky(np.exp(-((distance / length) ** 2)) + 1e-9 * np.eye(len(PLACES)))
    return np.random.default_rng(seed).standard_normal((PAIRS, 2, len(PLACES))) @ factor.T


def test_smooth_unrelated_fields_are_significant_as_often_as_the_level_says():
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / PAIRS)
    plain, spatial = [], []
    for x, y in fields(1.2, seed=1):
        plain.append(spearmanr(x, y).pvalue)
        spatial.append(spatial_p_value(x, y, PLACES, permuted=plain[-1]))
    assert np.mean(np.less_equal(plain, LEVEL)) > LEVEL + error  # neighbours pass for evidence
    assert abs(np.mean(np.less_equal(spatial, LEVEL)) - LEVEL) < error


def test_the_permutation_test_bounds_the_spatial_p_value():
    x = fields(1.0, seed=4)[0, 0]
    assert spatial_p_value(x, np.exp(x), PLACES, permuted=1e-9) == 1e-9
    nearly = x + 0.1 * np.sin(9 * np.arange(x.size))
    alone = spatial_p_value(x, nearly, PLACES, permuted=0.0)
    assert 0 < alone < 0.5 == spatial_p_value(x, nearly, PLACES, permuted=0.5)
    four = np.arange(4.0)
    assert spatial_p_value(four, four, PLACES[:4], permuted=2 / 24) == 2 / 24
    for y in (np.zeros(4), np.arange(3.0)):  # no spread, or too few patches
        assert np.isnan(spatial_p_value(four[: len(y)], y, PLACES[: len(y)], permuted=1.0))


@settings(max_examples=20, deadline=None)
@example(seed=2, scale=0.99999, count=16)  # the farthest classes end just at half of the extent
@given(seed=st.integers(0, 1000), scale=st.floats(0.01, 100), count=st.integers(4, SIDE**2))
def test_unit_place_and_order_do_not_matter(seed, scale, count):
    rng = np.random.default_rng(seed)
    x, y = fields(1.0, seed=5)[seed % PAIRS][:, :count]
    places = PLACES[:count]
    order = rng.permutation(count)
    same = spatial_p_value(x[order], np.exp(y[order]), places[order] * scale + 7.0, permuted=0.0)
    assert same == pytest.approx(spatial_p_value(x, y, places, permuted=0.0), rel=1e-9)
