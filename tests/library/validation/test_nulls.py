"""Chance, exact against brute force. benchmarks/chance.py has how often it claims too much."""

import math

import numpy as np
import pytest
import scipy

from gstlib.validation.masks import mask_counts, mask_scores
from gstlib.validation.nulls import Places, p_value, swapped_mcc


def test_scores_are_those_of_all_predictions_after_half_a_turn():
    rng = np.random.default_rng(0)
    drawn = rng.random((5, 30, 27))
    masks = dict(zip("abc", drawn < 0.1, strict=False))
    measured = drawn[4] < 0.8
    lost = measured & (drawn[3] < 0.2)
    places = {name: Places.packed(mask, lost, measured) for name, mask in masks.items()}
    other = np.ones((7, 7), dtype=bool)  # of another instrument
    scores = swapped_mcc("b", places | {"d": Places.packed(other, other, other)})
    expected = [
        mask_scores(*mask_counts(side[measured], lost[measured]))["mcc"]
        for name in "bac"
        for side in (masks[name], masks[name][::-1, ::-1])
    ]
    assert scores[0] == pytest.approx(expected[0])
    np.testing.assert_allclose(np.sort(scores), np.sort(expected), atol=1e-12)


def test_the_level_holds_on_striated_surfaces():
    """Predicted and lost areas follow the same direction, at unrelated positions."""
    rng = np.random.default_rng(1)
    claimed = []
    for _ in range(60):
        noise = scipy.ndimage.gaussian_filter(
            rng.standard_normal((2, 10, 48, 48)), (0, 0, 1, 12), mode="wrap"
        )
        predicted, lost = noise > np.quantile(noise, 0.85, axis=(2, 3), keepdims=True)
        known = np.ones((48, 48), dtype=bool)
        places = {
            str(number): Places.packed(*masks, known)
            for number, masks in enumerate(zip(predicted, lost, strict=True))
        }
        for patch in places:
            own, *null = swapped_mcc(patch, places)
            claimed.append(p_value(own, np.array(null)) <= 0.1)
    assert np.mean(claimed) < 0.13  # 600 patches; with quarter turns: 19 %


def test_p_value_counts_the_value_itself_and_ties():
    null = np.array([0.1, 0.2, 0.3, math.nan])
    assert [p_value(value, null) for value in (0.25, 0.3, 9.0)] == [2 / 4, 2 / 4, 1 / 4]
    assert math.isnan(p_value(math.nan, null))
    assert math.isnan(p_value(0.1, null[3:]))
