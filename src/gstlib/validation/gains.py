"""What is a patch's score worth? Held against chance, and against the best of the rivals.

The gain, score less that of the best rival, is what the contact solution adds to what a look at
the surface tells. The best rival is the one that did best on this very patch: being chosen by its
luck, it makes the gain look smaller, never larger.

What is high at T0 by error is in contact, and lost at T1: loss that is noise agrees with contact,
at its own place only, and no shift tells that from wear. Noise goes up as often as down. Where so
much rose that it may explain the loss, chance is not tested.
"""

import math

import numpy as np

from gstlib.validation.blocks import FEWEST_BLOCKS, draw_blocks, label_blocks, resampled_scores
from gstlib.validation.comparison import CONTACT, Comparison
from gstlib.validation.intervals import percentile_interval
from gstlib.validation.nulls import (
    draw_shifts,
    levels_of,
    p_value,
    shifted_fractions_skill,
    shifted_mask_scores,
    shifted_rank_scores,
)
from gstlib.validation.scores import SCORES
from gstlib.validation.seam import seam_factor

__all__ = ["null_scores", "weigh_patch"]

_LEVELS = 32
_NULL_RANGE = 0.025, 0.975
# Below this the transforms' rounding shows, where the value is 0.
_DECIMALS = 9


def null_scores(
    comparison: Comparison, *, shifts: int, generator: np.random.Generator
) -> dict[str, np.ndarray]:
    """Every score of the contact laid elsewhere, beyond the correlation length of the loss.

    Parameters
    ----------
    comparison : Comparison
    shifts : int
        How many places; fewer on a patch that has not so many.
    generator : numpy.random.Generator
        Which ones.

    Returns
    -------
    dict
        For each score an array, all over the same shifts; the first value is that of no shift.
        Of the others, those above their mean are drawn away from it for the torus' seam
        (`seam_factor`).
        Ranks are taken in levels, so that the rank scores differ a little from exact ones.
    """
    contact, loss, valid = comparison.predictions[CONTACT], comparison.loss, comparison.valid
    length = comparison.correlation_length
    places = draw_shifts(
        valid.shape,
        comparison.spacing,
        beyond=0.0 if math.isnan(length) else length,
        count=shifts,
        generator=generator,
    )
    places = np.vstack([[0, 0], places])
    of_masks = {
        **shifted_mask_scores(contact.mask, loss, valid, places),
        "fss": shifted_fractions_skill(contact.shares, comparison.loss_shares, valid, places),
    }
    levels = levels_of(contact.ranking, _LEVELS)
    of_ranks = shifted_rank_scores(levels, loss, valid, places)
    # ASSUME: what the torus' seam does to a sum of products, it does to every score made of it.
    factors = seam_factor(contact.mask, loss, valid), seam_factor(levels, loss, valid)
    return {
        name: _stretched(values, factor)
        for scores, factor in zip((of_masks, of_ranks), factors, strict=True)
        for name, values in scores.items()
    }


def _stretched(values: np.ndarray, factor: float) -> np.ndarray:
    """The scores of the shifts, all but the first, those above their mean drawn away from it.

    The ones below stay: where most shifts hit nothing at all, a patch that hits nothing either
    would else be better than they are.
    """
    elsewhere = values[1:]
    known = elsewhere[np.isfinite(elsewhere)]
    mean = known.mean() if known.size else math.nan
    return np.append(values[:1], elsewhere + (factor - 1) * np.maximum(elsewhere - mean, 0))


def weigh_patch(
    scores: dict[str, dict[str, float]],
    comparison: Comparison,
    null: dict[str, np.ndarray],
    *,
    most_noise: float,
    resamples: int,
    generator: np.random.Generator,
) -> list[dict[str, object]]:
    """A row for each score of a patch: against the null, and against the best rival.

    Parameters
    ----------
    scores : dict
        As from `scores_of`.
    comparison : Comparison
    null : dict
        As from `null_scores`.
    most_noise : float
        The `noise_share` up to which there are p-values.
    resamples : int
        Block bootstrap resamples for the interval of the gain.
    generator : numpy.random.Generator
        Source of chance for these.

    Returns
    -------
    list of dict
        ``score, value``; ``null_mean, null_low, null_high`` (95 % of the shifts lie between),
        ``effect_size`` (value less mean, in standard deviations of the shifts), ``p_value``
        (one-sided; NaN with too much noise), ``shifts``; ``best_rival, best_rival_value, gain,
        gain_low, gain_high`` (95 % block bootstrap), ``blocks``. No interval from fewer blocks than
        `FEWEST_BLOCKS`.
    """
    # ASSUME: blocks are twice as long as the distance at which the loss's autocorrelation has
    # fallen to 1/e, and the patch is divided evenly into them.
    length = 2 * comparison.correlation_length
    labels, blocks = label_blocks(
        comparison.valid, comparison.spacing, 0.0 if math.isnan(length) else length
    )
    resampled = {}
    if blocks >= FEWEST_BLOCKS:
        drawn = draw_blocks(blocks, resamples, generator)
        resampled = {
            name: resampled_scores(
                prediction, comparison.loss, comparison.loss_shares, labels, drawn
            )
            for name, prediction in comparison.predictions.items()
        }
    rows = []
    for score in SCORES:
        value = scores[CONTACT][score]
        here, elsewhere = null[score][0], null[score][1:]
        # `here` is the value in levels, as the null is
        elsewhere = elsewhere[np.isfinite(elsewhere)] + (value - here)
        row = {"score": score, "value": value, **_against_chance(value, elsewhere)}
        if comparison.noise_share > most_noise:
            row["p_value"] = math.nan
        rows.append(row | _gain(score, scores, resampled, blocks))
    return rows


def _against_chance(value: float, null: np.ndarray) -> dict[str, float]:
    """Where a score lies among those of the shifts."""
    mean, low, high, spread = (math.nan,) * 4
    if null.size > 1:
        found = (null.mean(), *np.quantile(null, _NULL_RANGE), null.std(ddof=1))
        mean, low, high, spread = (round(float(number), _DECIMALS) for number in found)
    return {
        "null_mean": mean,
        "null_low": low,
        "null_high": high,
        "effect_size": (value - mean) / spread if spread > 0 else math.nan,
        "p_value": p_value(value, null),
        "shifts": int(null.size),
    }


def _gain(
    score: str,
    scores: dict[str, dict[str, float]],
    resampled: dict[str, dict[str, np.ndarray]],
    blocks: int,
) -> dict[str, object]:
    """Score less that of the best rival, with its interval."""
    value = scores[CONTACT][score]
    rivals = {
        name: of_one[score]
        for name, of_one in scores.items()
        if name != CONTACT and not math.isnan(of_one.get(score, math.nan))
    }
    if not rivals or math.isnan(value):
        nothing = dict.fromkeys(("best_rival_value", "gain", "gain_low", "gain_high"), math.nan)
        return {"best_rival": "", **nothing, "blocks": blocks}
    best = max(rivals, key=rivals.get)
    gain = value - rivals[best]
    low = high = math.nan
    if resampled:
        samples = resampled[CONTACT][score] - resampled[best][score]
        # the first is the patch itself: exact ranks for ranks in levels
        low, high = percentile_interval(samples[1:] + (gain - samples[0]), blocks)
    return {
        "best_rival": best,
        "best_rival_value": rivals[best],
        "gain": round(gain, _DECIMALS),
        "gain_low": round(low, _DECIMALS),
        "gain_high": round(high, _DECIMALS),
        "blocks": blocks,
    }
