"""How good is a patch's prediction? Its scores against chance and against the best rival.

The gain is the score minus that of the best rival: what the contact solution adds to a look at the
surface. The best rival is the one that did best on this patch. It is selected on the same data, so
the gain can only look smaller than it is.

Noise mimics agreement: a point that noise raises at T0 is predicted to touch, and looks worn at
T1. No shift can distinguish that from wear, but noise raises as often as it lowers. If so much rose
that noise may explain the loss, chance is not tested. Nor is it tested if the loss correlates over
so large a share of the patch that shifts claim too much (`gstlib.validation.nulls.LONGEST`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import laid_height
from gstlib.io.results import columns_of
from gstlib.validation.change import wear_summary
from gstlib.validation.intervals import (
    FEWEST_BLOCKS,
    label_blocks,
    percentile_interval,
    resampled_scores,
)
from gstlib.validation.nulls import LONGEST, correlation_length, null_scores, p_value
from gstlib.validation.scores import CONTACT, RIVALS, SCORES, compare, scores_of

__all__ = ["NO_CHANCE", "Chance", "PatchScores", "Scoring", "patch_tables", "score_patch"]
__all__ += ["score_table"]

_NULL_RANGE = 0.025, 0.975
# Beyond these decimals, a value of 0 shows the rounding of the transforms.
_DECIMALS = 9
# Noise raises as often as it lowers: if this many times as much rose as fell, something is wrong.
_BEYOND_NOISE = 2


@dataclass(frozen=True)
class PatchScores:
    """All results about one patch in the validation tables."""

    scores: dict[
        str, Any
    ]  # row of validation_patches.csv, and what `wear_summary` says of the loss
    gains: list[dict[str, Any]]  # rows of validation_gains.csv; none if chance was not tested
    null: dict[str, np.ndarray]  # as from `null_scores`; empty where chance was not tested
    warning: str | None  # what to look into if too much rose, or if waves are too long to test


class Scoring(NamedTuple):
    """How patches are scored, as in the section ``validation`` of the config.

    Attributes
    ----------
    neighbourhood_um : float
        Window of the fractions skill score.
    rim : float
        Share of a side along each edge that is not scored.
    most_noise : float
        Largest area that rose, over the area that fell, with which a patch is tested.
    """

    neighbourhood_um: float
    rim: float
    most_noise: float


class Chance(NamedTuple):
    """What chance is drawn with.

    Attributes
    ----------
    seed : int or sequence of int
        Of the random numbers.
    shifts : int
        Of the null model; 0 leaves out chance and gains.
    resamples : int
        Of the block bootstrap.
    """

    seed: int | Sequence[int] = 0
    shifts: int = 0
    resamples: int = 0


NO_CHANCE = Chance()


def score_patch(
    patch: str,
    contact: xr.Dataset,
    change: xr.Dataset,
    scoring: Scoring,
    chance: Chance = NO_CHANCE,
) -> PatchScores:
    """Score the predicted contact of one patch against its measured loss.

    Parameters
    ----------
    patch : str
        Its id. With the seed it determines the random numbers, so a patch's results do not depend
        on the other patches in the study.
    contact : xarray.Dataset
        ``gap`` (y, x) in mm, ``pressure`` (y, x) in MPa, ``displacement`` in mm;
        and the heights at T0, which the rivals see as the patch lies on the stone
        (`gstlib.contact.laid_height`). The contact may be empty.
    change : xarray.Dataset
        As from `gstlib.validation.change.height_change`.
    scoring : Scoring
    chance : Chance
        By default chance is left out.
    """
    neighbourhood_um, rim, most_noise = scoring
    seed, shifts, resamples = chance
    heights = laid_height(contact)
    comparison = compare(heights, contact, change, neighbourhood_um=neighbourhood_um, rim=rim)
    loss, valid = comparison.loss, comparison.valid
    # only tests against chance need it, and it takes longer than all scores
    length = correlation_length(loss, valid, comparison.spacing) if shifts else math.nan
    longest = LONGEST * min(n * d for n, d in zip(valid.shape, comparison.spacing, strict=True))
    scores = {name: scores_of(one, comparison) for name, one in comparison.predictions.items()}
    touching, rigid = (comparison.predictions[name].mask for name in (CONTACT, "rigid"))
    gain = change["gain"].values.astype(bool) & valid
    noise_share = float(gain.sum() / loss.sum()) if loss.any() else math.nan
    noisy = noise_share > most_noise
    row: dict[str, Any] = {
        "patch": patch,
        "contact_fraction": float(touching.mean()),
        "valid_contact_fraction": _share(touching, valid),
        **wear_summary(change),
        "noise_share": noise_share,
        "believed": not noisy,
        "correlation_length_um": length * 1e3,
        "rigid_fraction": _share(rigid, valid),
    }
    for name, of_one in scores.items():
        prefix = "" if name == CONTACT else f"{name}_"
        row |= {f"{prefix}{score}": value for score, value in of_one.items()}
    gains, null = [], {}
    if shifts:
        generator = np.random.default_rng([*np.atleast_1d(seed), *patch.encode()])
        null = null_scores(comparison, beyond_mm=length, shifts=shifts, generator=generator)
        # ASSUME: blocks are twice as long as the distance at which the loss's autocorrelation has
        # fallen to 1/e, and divide the patch evenly.
        labels, blocks = label_blocks(valid, comparison.spacing, 2 * length)
        resampled = {}
        if blocks >= FEWEST_BLOCKS:
            drawn = generator.multinomial(blocks, np.full(blocks, 1 / blocks), size=resamples)
            resampled = {
                name: resampled_scores(prediction, comparison, labels, drawn)
                for name, prediction in comparison.predictions.items()
            }
        for score in SCORES:
            value = scores[CONTACT][score]
            of_score: dict[str, Any] = {"patch": patch, "score": score, "value": value}
            of_score |= _against_chance(value, null[score])
            of_score |= _against_rivals(score, scores, resampled, blocks)
            if noisy:
                of_score["untested"] = "noise"
            elif length > longest:
                of_score["untested"] = "long waves"
            elif math.isnan(length) or math.isnan(of_score["p_value"]):
                of_score["untested"] = "undefined"
            if of_score["untested"]:
                of_score["p_value"] = math.nan
            gains.append(of_score)
    return PatchScores(row, gains, null, _warning(row, most_noise, longest))


def patch_tables(found: Sequence[PatchScores]) -> dict[str, pd.DataFrame]:
    """The tables ``patches`` and ``gains``; empty without patches."""
    gains = [row for one in found for row in one.gains]
    return {
        "patches": score_table(found)[columns_of("validation_patches")],
        "gains": pd.DataFrame(gains, columns=columns_of("validation_gains")),
    }


def score_table(found: Sequence[PatchScores]) -> pd.DataFrame:
    """The table ``patches``, and ``loss_fraction``, which ``registration.csv`` states."""
    columns = [*columns_of("validation_patches"), "loss_fraction"]
    return pd.DataFrame([one.scores for one in found], columns=columns)


def _against_chance(value: float, scores: np.ndarray) -> dict[str, Any]:
    """Where a score stands among those of the shifts, of which the first is in place."""
    # the value in place is computed with levels, as the null is
    null = scores[1:][np.isfinite(scores[1:])] + (value - scores[0])
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
        "untested": "",
        "shifts": int(null.size),
    }


def _against_rivals(
    score: str,
    scores: dict[str, dict[str, float]],
    resampled: dict[str, dict[str, np.ndarray]],
    blocks: int,
) -> dict[str, Any]:
    """The score minus that of the best rival, with its interval."""
    value = scores[CONTACT][score]
    rivals = {name: scores[name].get(score, math.nan) for name in RIVALS}
    # none where the score of the contact is NaN
    rivals = {name: of_one for name, of_one in rivals.items() if math.isfinite(value - of_one)}
    best = max(rivals, key=lambda name: rivals[name], default="")
    gain = value - rivals.get(best, math.nan)
    low = high = math.nan
    if resampled and best:
        samples = resampled[CONTACT][score] - resampled[best][score]
        # the first is the patch itself: exact ranks replace ranks in levels
        low, high = percentile_interval(samples[1:] + (gain - samples[0]), blocks)
    return {
        "best_rival": best,
        "best_rival_value": rivals.get(best, math.nan),
        "gain": round(gain, _DECIMALS),
        "gain_low": round(low, _DECIMALS),
        "gain_high": round(high, _DECIMALS),
        "blocks": blocks,
    }


def _share(part: np.ndarray, whole: np.ndarray) -> float:
    """Share of the points of `whole` that are in `part`; NaN if there are none."""
    return float((part & whole).sum() / whole.sum()) if whole.any() else math.nan


def _warning(row: dict[str, Any], most_noise: float, longest: float) -> str | None:
    rose, fell, noise = (
        100 * row[k] for k in ("gain_fraction", "loss_fraction", "noise_share")
    )
    if rose > _BEYOND_NOISE * fell:
        return (
            f"patch {row['patch']}: far more rose than fell ({rose:.2g} % and {fell:.2g} % of the "
            "area), but use only removes material. If this is so on all patches, check "
            "scans.mould.invert; if on some, check for t0 and t1 exchanged in the patch table, "
            "or for residue on the stone."
        )
    if noise > 100 * most_noise:
        return (
            f"patch {row['patch']}: {noise:.0f} % as much rose as fell, so the loss may be noise, "
            "which mimics agreement with contact. It is not tested against chance, and left out of "
            "the statistics over patches. A larger traces.minimum_points removes noise."
        )
    if (length := row["correlation_length_um"]) > 1e3 * longest:
        return (
            f"patch {row['patch']}: the loss correlates over {length:.3g} µm. Above "
            f"{1e3 * longest:.3g} µm, unrelated maps of this size agree too often. It is not "
            "tested against chance. Larger scans can be tested."
        )
    return None
