"""How certain is a score? Bootstrap over blocks of a patch, or over the patches of a stone.

Neighbouring points wear together, so not points but square blocks, longer than the correlation
length, are drawn with replacement (block bootstrap: Künsch 1989, Ann. Stat. 17:1217). Each block
contributes its sums; the scores of a resample are the scores of the summed blocks.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy

from gstlib.validation.scores import Comparison, Prediction, rank_levels, scores_of_sums

__all__ = ["FEWEST_BLOCKS", "label_blocks", "percentile_interval", "resampled_scores"]

_CONFIDENCE = 0.95
# Resamples of n units lie between the smallest and the largest unit, which enclose the truth in
# 1 - 2 / 2ⁿ of cases: fewer units than this allow no interval at this confidence.
_FEWEST_UNITS = 6
# Fewer blocks than this do not show their own spread.
FEWEST_BLOCKS = 9
# More blocks along a side add nothing, and resamples of single points take much memory.
_MOST_ALONG_A_SIDE = 32
_LEVELS = 64


def label_blocks(
    valid: np.ndarray, spacing: Sequence[float], length: float
) -> tuple[np.ndarray, int]:
    """Number of the block of each valid point, -1 elsewhere; and the number of blocks with a point.

    Blocks are at least `length` (mm) long, if that is a number. They divide the patch (ny, nx)
    evenly, so no narrow block is left at its end.
    """
    rows, columns = (
        min(n, _MOST_ALONG_A_SIDE, max(1, int(n * step / length)) if length > 0 else n)
        for n, step in zip(valid.shape, spacing, strict=True)
    )
    row, column = (
        np.arange(n) * count // n for n, count in zip(valid.shape, (rows, columns), strict=True)
    )
    labels = row[:, None] * columns + column
    held = np.bincount(labels[valid], minlength=rows * columns) > 0
    return np.where(valid, (np.cumsum(held) - 1)[labels], -1), int(held.sum())


def resampled_scores(
    prediction: Prediction, comparison: Comparison, labels: np.ndarray, drawn: np.ndarray
) -> dict[str, np.ndarray]:
    """Every score of a prediction in every resample of the blocks: arrays (1 + resamples,).

    `drawn` (resamples, blocks) is how often each block is in each resample; the first value of
    each score has every block once. Ranks are taken in levels, so rank scores differ slightly from
    exact ones.
    """
    valid = labels >= 0
    block, loss, mask = labels[valid], comparison.loss[valid], prediction.mask[valid]
    blocks = drawn.shape[1]
    weights = np.vstack([np.ones(blocks), drawn])

    def counts(kind: np.ndarray, kinds: int) -> np.ndarray:
        """Number of points of each kind, without and with loss: (2, 1 + resamples, kinds)."""
        found = np.bincount((block * kinds + kind) * 2 + loss, minlength=blocks * kinds * 2)
        table = (weights @ found.reshape(blocks, -1)).reshape(len(weights), kinds, 2)
        return np.moveaxis(table, -1, 0)

    # counts out of the mask and in it, without and with loss
    (correct, false), (missed, hits) = np.moveaxis(counts(mask, 2), -1, 1)
    p, o = prediction.shares[valid], comparison.loss_shares[valid]
    levels = None
    if prediction.ranking is not None:
        level = rank_levels(prediction.ranking, _LEVELS)[valid]
        others, events = counts(level, int(level.max()) + 1)
        levels = events, others
    return scores_of_sums(
        (hits, hits + false, hits + missed, hits + false + missed + correct),
        tuple(
            weights @ np.bincount(block, product, blocks) for product in (p * o, p * p, o * o)
        ),
        levels,
    )


def percentile_interval(samples: np.ndarray, units: int) -> tuple[float, float]:
    """Bootstrap percentile interval at 95 %, widened for the number of units resampled.

    The plain percentiles of a mean are those of a normal distribution whose spread is divided by
    n, not n - 1; with a dozen units they enclose the truth in some 90 % of cases, not 95. Taken
    further out, at the tails that give Student's interval for a mean, they come close to their
    nominal level (Hesterberg 2015, Am. Stat. 69:371). NaN samples are left out; the interval is
    NaN with fewer than 6 units, or if the statistic is never defined.
    """
    samples = samples[np.isfinite(samples)]
    if units < _FEWEST_UNITS or not samples.size:
        return math.nan, math.nan
    tail = scipy.special.ndtr(
        scipy.special.stdtrit(units - 1, (1 - _CONFIDENCE) / 2) * math.sqrt(units / (units - 1))
    )
    low, high = np.quantile(samples, [tail, 1 - tail])
    return float(low), float(high)
