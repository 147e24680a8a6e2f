"""The test over patches that allows for neighbours being alike: nominal where exchange is not."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

from gstlib.validation.neighbours import effective_patches, neighbours_p_value

SIDE = 5
PLACES = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
LEVEL, PAIRS = 0.05, 400


def fields(length, seed):
    """Gaussian fields on the patches, correlated over `length`: (PAIRS, 2, patches)."""
    distance = np.hypot(*(PLACES[:, None] - PLACES).transpose(2, 0, 1))
    factor = np.linalg.cholesky(np.exp(-((distance / length) ** 2)) + 1e-9 * np.eye(len(PLACES)))
    return np.random.default_rng(seed).standard_normal((PAIRS, 2, len(PLACES))) @ factor.T


def claims(length, seed):
    """Rate of claims by exchange of patches, and with neighbours allowed for."""
    plain, allowed = [], []
    for x, y in fields(length, seed):
        plain.append(spearmanr(x, y).pvalue)
        allowed.append(neighbours_p_value(x, y, PLACES, exchanged=plain[-1]))
    return np.mean(np.less_equal(plain, LEVEL)), np.mean(np.less_equal(allowed, LEVEL))


def test_claims_come_as_often_as_the_level_says():
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / PAIRS)
    plain, allowed = claims(1.2, seed=1)
    assert plain > LEVEL + error  # without it, neighbours pass for evidence
    assert abs(allowed - LEVEL) < error


def test_nothing_is_lost_where_neighbours_are_unrelated():
    pairs = fields(0.1, seed=2)[:50]
    worth = [effective_patches(x, y, PLACES) for x, y in pairs]
    assert np.median(worth) > 0.9 * len(PLACES)
    assert max(worth) <= len(PLACES)


def test_smooth_fields_are_worth_fewer_patches():
    rough, smooth = (
        np.median([effective_patches(x, y, PLACES) for x, y in fields(length, seed=3)[:50]])
        for length in (0.5, 1.5)
    )
    assert smooth < 0.8 * rough


def test_a_perfect_relation_is_certain():
    x = fields(1.0, seed=4)[0, 0]
    assert neighbours_p_value(x, np.exp(x), PLACES, exchanged=1e-9) == 1e-9


def test_few_patches_prove_no_more_than_their_exchange():
    x = np.arange(4.0)
    assert neighbours_p_value(x, x, PLACES[:4], exchanged=2 / 24) == 2 / 24


@pytest.mark.parametrize("y", [np.zeros(4), np.array([1.0, 2.0, 3.0])])
def test_no_p_value_without_spread_or_patches(y):
    assert np.isnan(neighbours_p_value(np.arange(len(y)), y, PLACES[: len(y)], exchanged=1.0))


@settings(max_examples=20, deadline=None)
@example(seed=2, scale=0.99999, count=16)  # the farthest classes end just at half of the extent
@given(seed=st.integers(0, 1000), scale=st.floats(0.01, 100), count=st.integers(4, SIDE**2))
def test_unit_place_and_order_do_not_matter(seed, scale, count):
    rng = np.random.default_rng(seed)
    x, y = fields(1.0, seed=5)[seed % PAIRS][:, :count]
    places = PLACES[:count]
    order = rng.permutation(count)
    same = neighbours_p_value(
        x[order], np.exp(y[order]), places[order] * scale + 7.0, exchanged=0.0
    )
    assert same == pytest.approx(neighbours_p_value(x, y, places, exchanged=0.0), rel=1e-9)
