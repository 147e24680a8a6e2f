"""Chance: exact against brute force, nominal without a relation, sharp with one."""

import math

import numpy as np
import pytest
import scipy.ndimage
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.masks import mask_counts, mask_scores
from gstlib.validation.nulls import Places, p_value, swapped_mcc


def field(rng, length, size=64):
    """A correlated random field, cut out of a larger one: it does not wrap."""
    wide = scipy.ndimage.gaussian_filter(rng.standard_normal((size + 40, size + 40)), length)
    return wide[20:-20, 20:-20]


def top(values, share):
    return values > np.quantile(values, 1 - share)


def turned(mask):
    """A mask in all turns and mirrorings that keep its shape."""
    both = [mask, mask[:, ::-1], mask[::-1], mask[::-1, ::-1]]
    return both + ([side.T for side in both] if mask.shape[0] == mask.shape[1] else [])


@pytest.mark.parametrize("shape", [(30, 30), (30, 27)])
def test_scores_are_those_of_all_predictions_turned_and_mirrored(shape):
    rng = np.random.default_rng(0)
    masks = {name: top(field(rng, 2, 30)[: shape[0], : shape[1]], 0.1) for name in "abc"}
    lost, known = top(field(rng, 3, 30)[: shape[0], : shape[1]], 0.2), np.ones(shape, dtype=bool)
    known[:4], known[:, 22:], known[10, 10] = False, False, False
    places = {name: Places.of(mask, lost & known, known) for name, mask in masks.items()}
    other = np.ones((7, 7), dtype=bool)  # of another instrument
    found = swapped_mcc("b", places | {"d": Places.of(other, other, other)})
    expected = [
        mask_scores(*mask_counts(side, lost, known))["mcc"]
        for name in "bac"
        for side in turned(masks[name])
    ]
    assert found[0] == pytest.approx(expected[0])
    np.testing.assert_allclose(np.sort(found), np.sort(expected), atol=1e-12)


def test_of_thousands_of_patches_a_part_is_enough(monkeypatch):
    monkeypatch.setattr("gstlib.validation.nulls._MOST_PATCHES", 5)
    rng = np.random.default_rng(2)
    masks = rng.random((12, 3, 8, 8)) > 0.5
    masks[:, 1] &= masks[:, 2]  # lost where that is known
    places = {str(number): Places.of(*mask) for number, mask in enumerate(masks)}
    assert len(swapped_mcc("7", places)) == 8 * (1 + 4)
    assert len(swapped_mcc("7", {"7": places["7"]})) == 8


def test_p_value_counts_the_value_itself_and_ties():
    null = np.array([0.1, 0.2, 0.3, math.nan])
    assert p_value(0.25, null) == 2 / 4
    assert p_value(0.3, null) == 2 / 4
    assert p_value(9.0, null) == 1 / 4
    assert math.isnan(p_value(math.nan, null))
    assert math.isnan(p_value(0.1, np.array([math.nan])))


def p_values(rng, predicted, lost):
    """Of patches with a field each that predicts, and one that is lost."""
    known = np.ones((64, 64), dtype=bool)
    known[:6], known[:, 57:] = False, False
    places = {
        str(number): Places.of(top(one, 0.08), top(other, 0.15) & known, known)
        for number, (one, other) in enumerate(zip(predicted, lost, strict=True))
    }
    nulls = (swapped_mcc(patch, places) for patch in places)
    return [p_value(null[0], null[1:]) for null in nulls]


def levelled(rng):
    """A piece of a self-affine surface with waves much longer than it: highest at its edges."""
    wide = self_affine_field(rng, 256, 1.0, hurst_exponent=0.8, roll_off=256.0)
    return remove_plane(make_surface(wide[:64, :64].astype(float), 1e-3))[0].values


@pytest.mark.parametrize("draw", [lambda rng: field(rng, 3), levelled])
def test_unrelated_fields_are_significant_as_often_as_the_level_says(draw):
    rng, drawn = np.random.default_rng(5), []
    for _ in range(15):
        drawn += p_values(rng, *([draw(rng) for _ in range(12)] for _ in range(2)))
    for level in (0.05, 0.2):
        error = 3 * math.sqrt(level * (1 - level) / len(drawn))
        assert (np.array(drawn) <= level).mean() == pytest.approx(level, abs=error)
