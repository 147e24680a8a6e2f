"""How well does a prediction agree with what was seen? Scores of masks and of rankings.

Every score here is a function of a few sums over the points compared: how many were hit, how many
marked, and so on. A null that moves the prediction and an interval that draws blocks of the patch
only make other sums, thousands at once; they come back here, so that a score has one definition.
"""

import math

import numpy as np
import scipy.ndimage

__all__ = [
    "MASK_SCORES",
    "RANK_SCORES",
    "SCORES",
    "average_precision",
    "fractions",
    "fractions_skill",
    "fractions_skill_of_sums",
    "mask_scores",
    "mask_scores_of_counts",
    "rank_scores",
    "rank_scores_of_counts",
    "roc_auc",
]

MASK_SCORES = "precision", "recall", "f1", "iou", "mcc"
RANK_SCORES = "roc_auc", "pr_auc"
SCORES = *MASK_SCORES, "fss", *RANK_SCORES


def mask_scores(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None
) -> dict[str, float]:
    """Agreement of two masks.

    Parameters
    ----------
    predicted, observed : array_like of bool
        Masks of one shape.
    valid : array_like of bool, optional
        Where to compare; everywhere by default.

    Returns
    -------
    dict
        ``precision`` (share of the predicted that is observed; NaN if nothing is predicted),
        ``recall`` (share of the observed that is predicted; NaN if nothing is observed), ``f1``
        (their harmonic mean, the Dice coefficient) and ``iou`` (intersection over union), both NaN
        if both masks are empty, 0 if only one is; ``mcc`` (Matthews' correlation coefficient, 0 at
        chance whatever the areas; NaN if a mask is empty or full).
    """
    predicted, observed, valid = _masks(predicted, observed, valid)
    scores = mask_scores_of_counts(
        (predicted & observed & valid).sum(),
        (predicted & valid).sum(),
        (observed & valid).sum(),
        valid.sum(),
    )
    return {name: float(value) for name, value in scores.items()}


def mask_scores_of_counts(
    hits: np.ndarray, marked: np.ndarray, present: np.ndarray, measured: np.ndarray
) -> dict[str, np.ndarray]:
    """The scores of `mask_scores`, from how many points were hit, marked, present and measured.

    The counts broadcast against each other: one score for each set of counts.
    """
    hits, marked, present, measured = (
        np.asarray(count, dtype=float) for count in (hits, marked, present, measured)
    )
    spread = marked * (measured - marked) * present * (measured - present)
    return {
        "precision": _ratio(hits, marked),
        "recall": _ratio(hits, present),
        "f1": _ratio(2 * hits, marked + present),
        "iou": _ratio(hits, marked + present - hits),
        "mcc": _ratio(hits * measured - marked * present, np.sqrt(np.maximum(spread, 0))),
    }


def fractions(mask: np.ndarray, size: int, valid: np.ndarray | None = None) -> np.ndarray:
    """Share of the valid points in a square window around each point that the mask marks.

    Parameters
    ----------
    mask : (ny, nx) array_like of bool
    size : int
        Odd side of the window, in elements; it is cut off at the edges.
    valid : (ny, nx) array_like of bool, optional
        Points that count; all by default.

    Returns
    -------
    (ny, nx) ndarray
        From 0 to 1; 0 where no valid point is in the window.
    """
    mask, _, valid = _masks(mask, mask, valid)
    if size < 1 or size % 2 == 0:
        raise ValueError(f"the window must be an odd number of elements wide, not {size}")
    if size == 1:
        return (mask & valid).astype(float)
    marked, there = (
        np.rint(scipy.ndimage.uniform_filter(m.astype(float), size, mode="constant") * size**2)
        for m in (mask & valid, valid)
    )
    return np.divide(marked, there, out=np.zeros_like(marked), where=there > 0)


def fractions_skill(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None, *, size: int
) -> float:
    """Fractions skill score (Roberts and Lean 2008, Mon. Weather Rev. 136:78): near counts as hit.

    Compared are not points but the shares of a window that are marked, so that a miss by less
    than the window is forgiven: 1 - Σ(p - o)² / Σ(p² + o²). A window of one element gives F1.

    Parameters
    ----------
    predicted, observed : (ny, nx) array_like of bool
        The prediction is known everywhere; what was observed, where valid.
    valid : (ny, nx) array_like of bool, optional
        Where to compare; everywhere by default.
    size : int
        Odd side of the window, in elements.

    Returns
    -------
    float
        From 0 to 1, at most 2 a / (1 + a²) where the areas' ratio is a; NaN if both are empty.
    """
    predicted, observed, valid = _masks(predicted, observed, valid)
    p, o = fractions(predicted, size)[valid], fractions(observed, size, valid)[valid]
    return float(fractions_skill_of_sums(p @ o, p @ p, o @ o))


def fractions_skill_of_sums(
    product: np.ndarray, predicted: np.ndarray, observed: np.ndarray
) -> np.ndarray:
    """The score of `fractions_skill` from the sums of p o, p² and o² over the valid points."""
    return _ratio(2 * np.asarray(product, dtype=float), np.asarray(predicted) + observed)


def rank_scores(
    score: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None
) -> dict[str, float]:
    """How well a number ranks the points at which the event was above the others.

    Parameters
    ----------
    score : array_like of float
        Larger where the event is thought likelier; no NaN where valid.
    observed : array_like of bool
        Where the event was.
    valid : array_like of bool, optional
        Where to compare; everywhere by default.

    Returns
    -------
    dict
        ``roc_auc``: probability that a random point of the event scores above a random other one,
        ties counting half (area under the receiver operating characteristic); ``pr_auc``: average
        precision, the mean over the events of the precision at each one's score (area under the
        precision-recall curve without interpolation), whose level at chance is the prevalence.
        Both NaN if the event is nowhere or everywhere.
    """
    score = np.asarray(score, dtype=float)
    observed, _, valid = _masks(observed, observed, valid)
    if score.shape != observed.shape:
        raise ValueError(f"score has shape {score.shape}, the mask {observed.shape}")
    values, event = score[valid], observed[valid]
    if np.isnan(values).any():
        raise ValueError("the score is NaN at a valid point")
    if not event.any() or event.all():
        return dict.fromkeys(RANK_SCORES, math.nan)
    order = np.argsort(-values)
    values, event = values[order], event[order]
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    events = np.add.reduceat(event.astype(np.int64), starts)
    sizes = np.diff(np.r_[starts, values.size])
    return {
        name: float(value) for name, value in rank_scores_of_counts(events, sizes - events).items()
    }


def rank_scores_of_counts(events: np.ndarray, others: np.ndarray) -> dict[str, np.ndarray]:
    """The scores of `rank_scores`, from how many points of each kind lie at each level.

    Parameters
    ----------
    events, others : (..., levels) array_like
        Points with and without the event at each level of the score, the highest level first.

    Returns
    -------
    dict
        Arrays of shape (...); points at the same level count as ties.
    """
    events, others = np.asarray(events, dtype=float), np.asarray(others, dtype=float)
    found, passed = events.cumsum(axis=-1), others.cumsum(axis=-1)
    positives, negatives = found[..., -1], passed[..., -1]
    both = (positives > 0) & (negatives > 0)
    above = (others * (found - events / 2)).sum(axis=-1)
    precision = _ratio(found, found + passed)
    return {
        "roc_auc": np.where(both, _ratio(above, positives * negatives), np.nan),
        "pr_auc": np.where(both, _ratio(np.nansum(events * precision, axis=-1), positives), np.nan),
    }


def roc_auc(score: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None) -> float:
    """Area under the receiver operating characteristic: see `rank_scores`."""
    return rank_scores(score, observed, valid)["roc_auc"]


def average_precision(
    score: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None
) -> float:
    """Area under the precision-recall curve: see `rank_scores`."""
    return rank_scores(score, observed, valid)["pr_auc"]


def _masks(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    predicted, observed = np.asarray(predicted, dtype=bool), np.asarray(observed, dtype=bool)
    valid = np.ones(observed.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    if not predicted.shape == observed.shape == valid.shape:
        raise ValueError(f"masks have shapes {predicted.shape}, {observed.shape} and {valid.shape}")
    return predicted, observed, valid


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Part over whole; NaN where the whole is 0."""
    part, whole = np.broadcast_arrays(part, whole)
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
