"""How sure is a patch of its scores? Blocks of the patch, drawn anew.

Neighbouring points wear together, so that not points but square blocks, longer than the
autocorrelation, are drawn with replacement (block bootstrap: Künsch 1989, Ann. Stat. 17:1217).
Every block brings its sums; the scores of a resample are the scores of the summed blocks.
"""

from collections.abc import Sequence

import numpy as np

from gstlib.validation.nulls import levels_of
from gstlib.validation.rivals import Prediction
from gstlib.validation.scores import (
    fractions_skill_of_sums,
    mask_scores_of_counts,
    rank_scores_of_counts,
)

__all__ = ["FEWEST_BLOCKS", "draw_blocks", "label_blocks", "resampled_scores"]

# Fewer blocks than this say nothing about their own spread.
FEWEST_BLOCKS = 9
# More blocks along a side tell nothing more, and a resample of single points takes much memory.
_MOST_ACROSS = 32
_LEVELS = 64


def label_blocks(
    valid: np.ndarray, spacing: Sequence[float], length: float
) -> tuple[np.ndarray, int]:
    """Which block each valid point lies in, the blocks being at least `length` (mm) long.

    The patch is divided evenly, so that no narrow block is left at its end.

    Parameters
    ----------
    valid : (ny, nx) array_like of bool
    spacing : (dy, dx)
        mm.
    length : float
        mm.

    Returns
    -------
    labels : (ny, nx) ndarray of int
        From 0; -1 where not valid.
    count : int
        Number of blocks that hold a valid point.
    """
    valid = np.asarray(valid, dtype=bool)
    across = [
        min(n, _MOST_ACROSS, max(1, int(n * step / length)) if length > 0 else n)
        for n, step in zip(valid.shape, spacing, strict=True)
    ]
    row, column = (
        np.arange(n) * blocks // n for n, blocks in zip(valid.shape, across, strict=True)
    )
    labels = row[:, None] * across[1] + column
    held = np.bincount(labels[valid], minlength=across[0] * across[1]) > 0
    return np.where(valid, (np.cumsum(held) - 1)[labels], -1), int(held.sum())


def draw_blocks(count: int, resamples: int, generator: np.random.Generator) -> np.ndarray:
    """How often each of `count` blocks is in each resample: (resamples, count)."""
    return generator.multinomial(count, np.full(count, 1 / count), size=resamples)


def resampled_scores(
    prediction: Prediction,
    observed: np.ndarray,
    observed_shares: np.ndarray,
    labels: np.ndarray,
    drawn: np.ndarray,
) -> dict[str, np.ndarray]:
    """Every score of a prediction in every resample, and on the patch itself.

    Parameters
    ----------
    prediction : Prediction
        One without a ranking has no rank scores.
    observed : (ny, nx) ndarray of bool
        What was seen.
    observed_shares : (ny, nx) ndarray
        Share of the window around each point where it was seen.
    labels : (ny, nx) ndarray of int
        As from `label_blocks`.
    drawn : (resamples, blocks) ndarray of int
        As from `draw_blocks`.

    Returns
    -------
    dict
        For each score an array (1 + resamples,), the first with every block once. Ranks are taken
        in levels, so that the rank scores differ a little from exact ones.
    """
    valid = labels >= 0
    block, seen, mask = labels[valid], observed[valid], prediction.mask[valid]
    blocks = drawn.shape[1]
    weights = np.vstack([np.ones(blocks, dtype=drawn.dtype), drawn]).astype(float)

    def counts(kind: np.ndarray, kinds: int) -> np.ndarray:
        """How many points of each kind, without and with the event: (1 + resamples, kinds, 2)."""
        found = np.bincount((block * kinds + kind) * 2 + seen, minlength=blocks * kinds * 2)
        return (weights @ found.reshape(blocks, -1)).reshape(len(weights), kinds, 2)

    table = counts(mask, 2)
    scores = mask_scores_of_counts(
        table[:, 1, 1], table[:, 1].sum(-1), table[:, :, 1].sum(-1), table.sum((1, 2))
    )
    p, o = prediction.shares[valid], observed_shares[valid]
    scores["fss"] = fractions_skill_of_sums(
        *(weights @ np.bincount(block, product, blocks) for product in (p * o, p * p, o * o))
    )
    if prediction.ranking is not None:
        levels = levels_of(prediction.ranking, _LEVELS)[valid]
        others, events = np.moveaxis(counts(levels, int(levels.max()) + 1), -1, 0)
        scores |= rank_scores_of_counts(events, others)
    return scores
