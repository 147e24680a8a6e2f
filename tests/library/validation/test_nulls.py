"""Chance, exact against brute force. benchmarks/chance.py has how often it claims too much."""

import math

import numpy as np
import pytest

from gstlib.validation.masks import mask_counts, mask_scores
from gstlib.validation.nulls import Places, p_value, swapped_mcc


@pytest.mark.parametrize("columns", [30, 27])
def test_scores_are_those_of_all_predictions_turned_and_mirrored(columns):
    rng = np.random.default_rng(0)
    drawn = rng.random((5, 30, columns))
    masks = dict(zip("abc", drawn < 0.1, strict=False))
    measured = drawn[4] < 0.8
    lost = measured & (drawn[3] < 0.2)
    places = {name: Places.packed(mask, lost, measured) for name, mask in masks.items()}
    other = np.ones((7, 7), dtype=bool)  # of another instrument
    scores = swapped_mcc("b", places | {"d": Places.packed(other, other, other)})
    expected = []
    for name in "bac":
        for turns in range(0, 4, 1 if columns == 30 else 2):
            turned = np.rot90(masks[name], turns)
            for side in (turned, turned[:, ::-1]):
                expected.append(mask_scores(*mask_counts(side, lost, measured))["mcc"])
    assert scores[0] == pytest.approx(expected[0])
    np.testing.assert_allclose(np.sort(scores), np.sort(expected), atol=1e-12)


def test_p_value_counts_the_value_itself_and_ties():
    null = np.array([0.1, 0.2, 0.3, math.nan])
    assert [p_value(value, null) for value in (0.25, 0.3, 9.0)] == [2 / 4, 2 / 4, 1 / 4]
    assert math.isnan(p_value(math.nan, null))
    assert math.isnan(p_value(0.1, null[3:]))
