"""Chance: exact against brute force, nominal without a relation, sharp with one."""

import math

import numpy as np
import pytest
import scipy

from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.masks import mask_counts, mask_scores
from gstlib.validation.nulls import Places, p_value, swapped_mcc


def field(rng, length, size=64):
    """A correlated random field, cut out of a larger one: it does not wrap."""
    wide = scipy.ndimage.gaussian_filter(
        rng.standard_normal((size + 40, size + 40)), length
    )
    return wide[20:-20, 20:-20]


def top(values, share):
    return values > np.quantile(values, 1 - share)


@pytest.mark.parametrize("columns", [30, 27])
def test_scores_are_those_of_all_predictions_turned_and_mirrored(columns):
    rng = np.random.default_rng(0)
    masks = {name: top(field(rng, 2, 30)[:, :columns], 0.1) for name in "abc"}
    measured = np.ones((30, columns), dtype=bool)
    measured[:4], measured[:, 22:] = False, False
    lost = top(field(rng, 3, 30)[:, :columns], 0.2) & measured
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


def levelled(rng):
    """A piece of a self-affine surface with waves much longer than it: highest at its edges."""
    wide = self_affine_field(rng, 256, 1.0, hurst_exponent=0.8, roll_off=256.0)
    return remove_plane(make_surface(wide[:64, :64].astype(float), 1e-3))[0].values


def test_unrelated_fields_are_significant_as_often_as_the_level_says():
    rng, p_values = np.random.default_rng(5), []
    measured = np.ones((64, 64), dtype=bool)
    measured[:6], measured[:, 57:] = False, False
    for _ in range(8):
        places = {}
        for number in range(12):
            lost = top(levelled(rng), 0.15) & measured
            places[number] = Places.packed(top(levelled(rng), 0.08), lost, measured)
        for patch in places:
            score, *null = swapped_mcc(patch, places)
            p_values.append(p_value(score, np.array(null)))
    for level in (0.05, 0.2):
        error = 3 * math.sqrt(level * (1 - level) / len(p_values))
        assert np.mean(np.less_equal(p_values, level)) == pytest.approx(
            level, abs=error
        )
