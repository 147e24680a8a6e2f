"""How well does a prediction of wear agree with the measured loss? Scores, and rival predictions.

Every score is a function of a few sums over the points: how many were hit, how many predicted, and
so on. The null model shifts the prediction and the bootstrap draws blocks of the patch; both only
make other sums, thousands at once, for `scores_of_sums`.

- ``precision``: share of the predicted that is observed; NaN if nothing is predicted.
- ``recall``: share of the observed that is predicted; NaN if nothing is observed.
- ``f1``: their harmonic mean, the Dice coefficient; NaN if both masks are empty, 0 if only one is.
  The intersection over union says the same: it is f1 / (2 - f1).
- ``mcc``: Matthews' correlation coefficient, 0 at chance whatever the areas; NaN if a mask is empty
  or full.
- ``fss``: fractions skill score (Roberts and Lean 2008, Mon. Weather Rev. 136:78). It compares the
  shares p and o of a window that are predicted and observed, and so forgives a miss by less than
  the window: 1 - Σ(p - o)² / Σ(p² + o²). A window of one element gives F1. At most 2 a / (1 + a²)
  for areas in the ratio a; NaN if both are empty.
- ``roc_auc``: probability that a random point with loss ranks above a random other one, ties
  counting half (area under the receiver operating characteristic).
- ``pr_auc``: average precision, the mean over the points with loss of the precision at each one's
  rank (area under the precision-recall curve without interpolation); at chance the prevalence.
  Both NaN if loss is nowhere or everywhere.

The contact solution is worth its cost only for what it adds to a look at the surface. The rivals
know the heights before use and, to make the comparison fair, the size of the contact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import xarray as xr

from gstlib.surface import spacing_of

__all__ = [
    "CONTACT",
    "RIVALS",
    "SCORES",
    "Comparison",
    "Prediction",
    "compare",
    "inside_rim",
    "rank_levels",
    "scores_of",
    "scores_of_sums",
    "window_shares",
]

SCORES = "precision", "recall", "f1", "mcc", "fss", "roc_auc", "pr_auc"

CONTACT = "contact"  # the prediction under test
RIVALS = "highest", "rigid"


@dataclass(frozen=True)
class Prediction:
    """Where wear is expected; arrays of shape (ny, nx)."""

    mask: np.ndarray  # where wear is expected
    shares: np.ndarray  # share of the window around each point that the mask marks
    ranking: np.ndarray | None  # larger where wear is likelier; None if another ranks the same


@dataclass(frozen=True)
class Comparison:
    """The predictions for one patch beside its measured loss; arrays of shape (ny, nx)."""

    predictions: dict[str, Prediction]  # by name: `CONTACT` and `RIVALS`
    loss: np.ndarray  # where height was lost
    valid: np.ndarray  # where that is known
    loss_shares: np.ndarray  # share of the window around each point that lost height
    spacing: tuple[float, float]  # (dy, dx), mm


def compare(
    heights: xr.DataArray,
    contact: xr.Dataset,
    change: xr.Dataset,
    *,
    neighbourhood_um: float,
    rim: float = 0.0,
) -> Comparison:
    """Compare the contact solution of a patch and its rivals with the loss.

    ``contact``: p > 0, ranked by the pressure and, out of contact, by the gap, so a point that
    nearly touches ranks above one far from contact. ``highest``: the highest of the valid points,
    as many as are in contact (of equal ones the first in row order), ranked by height. ``rigid``:
    what a rigid flat at the same displacement, from first touch, cuts off; it ranks by height, too.
    Rigid interpenetration at the *area* of the contact equals the highest points, so it is no third
    rival. Parameters as in `gstlib.validation.scoring.score_patch`.
    """
    pressure, z = contact["pressure"].values, heights.values
    valid = np.isfinite(change["change"].values) & inside_rim(z.shape, rim)
    if not z.shape == pressure.shape == valid.shape:
        raise ValueError(
            f"T0, pressure and change have shapes {z.shape}, {pressure.shape}, {valid.shape}"
        )
    spacing = spacing_of(heights)
    loss = change["loss"].values.astype(bool) & valid
    # the odd number of elements nearest to the neighbourhood, at least 1
    window = 2 * max(0, round((neighbourhood_um * 1e-3 / max(spacing) - 1) / 2)) + 1
    touching = pressure > 0
    points = np.flatnonzero(valid)
    order = np.argsort(-z.flat[points], kind="stable")
    highest = np.zeros_like(valid)
    highest.flat[points[order[: (touching & valid).sum()]]] = True
    rigid = z > z.max() - float(contact["displacement"])
    found = {
        CONTACT: (
            touching,
            np.where(touching, pressure, -np.maximum(contact["gap"].values, 0)),
        ),
        "highest": (highest, z),
        "rigid": (rigid, None),
    }
    return Comparison(
        predictions={
            name: Prediction(mask, window_shares(mask, window, np.ones_like(mask)), ranking)
            for name, (mask, ranking) in found.items()
        },
        loss=loss,
        valid=valid,
        loss_shares=window_shares(loss, window, valid),
        spacing=spacing,
    )


def inside_rim(shape: Sequence[int], rim: float) -> np.ndarray:
    """Points (ny, nx) further than the share `rim` of a side from every edge: those scored.

    A patch is cut out of the stone: at its edges no neighbour is pressed down with it.
    """
    rows, columns = (abs((np.arange(n) + 0.5) / n - 0.5) <= 0.5 - rim for n in shape)
    return rows[:, None] & columns


def window_shares(mask: np.ndarray, size: int, valid: np.ndarray) -> np.ndarray:
    """Share of the valid points in a window around each point that the mask (ny, nx) marks.

    The window is square, `size` elements a side, an odd number, and is cut off at the edges. The
    share is 0 where the window holds no valid point.
    """
    marked, there = (
        np.rint(scipy.ndimage.uniform_filter(m.astype(float), size, mode="constant") * size**2)
        for m in (mask & valid, valid)
    )
    return np.divide(marked, there, out=np.zeros_like(marked), where=there > 0)


def scores_of(prediction: Prediction, comparison: Comparison) -> dict[str, float]:
    """Every score of one prediction, exactly; one without a ranking has no rank scores."""
    mask, loss, valid = prediction.mask, comparison.loss, comparison.valid
    counts = [points.sum() for points in (mask & loss, mask & valid, loss, valid)]
    p, o = prediction.shares[valid], comparison.loss_shares[valid]
    levels = None
    if prediction.ranking is not None:
        _, level = np.unique(-prediction.ranking[valid], return_inverse=True)
        points, events = np.bincount(level), np.bincount(level[loss[valid]])
        events = np.pad(events, (0, points.size - events.size))
        levels = events, points - events
    found = scores_of_sums(counts, (p @ o, p @ p, o @ o), levels)
    return {name: float(value) for name, value in found.items()}


def scores_of_sums(
    counts: Sequence, products: Sequence, levels: tuple[np.ndarray, np.ndarray] | None
) -> dict[str, np.ndarray]:
    """Every score from sums over the valid points, which broadcast.

    `counts` are the numbers of points that are hit, predicted, observed and measured; `products`
    the sums of p o, p² and o² of the windows' shares; `levels` the numbers of points with and
    without loss at each level of the ranking (..., levels), the highest level first. Points at the
    same level are ties. Without a ranking there are no rank scores.
    """
    hits, predicted, observed, measured = (np.asarray(count, dtype=float) for count in counts)
    product, of_p, of_o = (np.asarray(total, dtype=float) for total in products)
    spread = predicted * (measured - predicted) * observed * (measured - observed)
    scores = {
        "precision": _ratio(hits, predicted),
        "recall": _ratio(hits, observed),
        "f1": _ratio(2 * hits, predicted + observed),
        "mcc": _ratio(hits * measured - predicted * observed, np.sqrt(np.maximum(spread, 0))),
        "fss": _ratio(2 * product, of_p + of_o),
    }
    if levels is None:
        return scores
    events, others = (np.asarray(count, dtype=float) for count in levels)
    found, passed = events.cumsum(axis=-1), others.cumsum(axis=-1)
    positives, negatives = events.sum(axis=-1), others.sum(axis=-1)
    both = (positives > 0) & (negatives > 0)
    above = (others * (found - events / 2)).sum(axis=-1)
    precise = np.nansum(events * _ratio(found, found + passed), axis=-1)
    scores["roc_auc"] = np.where(both, _ratio(above, positives * negatives), np.nan)
    scores["pr_auc"] = np.where(both, _ratio(precise, positives), np.nan)
    return scores


def rank_levels(ranking: np.ndarray, count: int) -> np.ndarray:
    """A ranking in about `count` levels, 0 the highest, finer towards the top.

    Half of the levels divide the highest tenth of the points, in equal steps of the logarithm of
    the share above; the others divide the rest evenly. Average precision is decided at the top.
    """
    top = np.geomspace(10 / ranking.size, 0.1, count // 2, endpoint=False)
    shares = np.r_[top, np.linspace(0.1, 1, count - count // 2, endpoint=False)]
    edges = np.unique(np.quantile(ranking, 1 - shares))
    return edges.size - np.searchsorted(edges, ranking, side="right")


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Part over whole; NaN where the whole is 0."""
    part, whole = np.broadcast_arrays(part, whole)
    return np.divide(part, whole, out=np.full(part.shape, np.nan), where=whole > 0)
