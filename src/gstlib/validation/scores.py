"""Does height go where contact was predicted? Scores of one patch, and rank correlations of many.

A score means little alone: each stands beside that of a rival that needs no mechanics, the highest
points of the patch at equal area, whose columns begin with ``highest_``.
"""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.validation.change import wear_summary

__all__ = [
    "contact_ranking",
    "highest_points",
    "mask_scores",
    "rank_correlations",
    "roc_auc",
    "score_patch",
]

# Up to this many patches all pairings are tried (8! = 40320), beyond it a random sample of them.
_EXACT_UP_TO = 8
_RANDOM_PAIRINGS = 9999
_CONFIDENCE = 0.95


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
        if both masks are empty, 0 if only one is.
    """
    predicted, observed, valid = _masks(predicted, observed, valid)
    hits = int((predicted & observed & valid).sum())
    marked = int((predicted & valid).sum())
    present = int((observed & valid).sum())
    return {
        "precision": _ratio(hits, marked),
        "recall": _ratio(hits, present),
        "f1": _ratio(2 * hits, marked + present),
        "iou": _ratio(hits, marked + present - hits),
    }


def roc_auc(score: np.ndarray, observed: np.ndarray, valid: np.ndarray | None = None) -> float:
    """Probability that a random observed point scores above a random other one; ties count half.

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
    float
        Area under the receiver operating characteristic, from the Mann-Whitney statistic; NaN if
        the event is everywhere or nowhere.
    """
    from scipy.stats import rankdata

    score = np.asarray(score, dtype=float)
    observed, _, valid = _masks(observed, observed, valid)
    if score.shape != observed.shape:
        raise ValueError(f"score has shape {score.shape}, the mask {observed.shape}")
    values, event = score[valid], observed[valid]
    if np.isnan(values).any():
        raise ValueError("the score is NaN at a valid point")
    positives = int(event.sum())
    negatives = event.size - positives
    if not positives or not negatives:
        return math.nan
    rank_sum = float(rankdata(values)[event].sum())
    return (rank_sum - positives * (positives + 1) / 2) / (positives * negatives)


def highest_points(heights: np.ndarray, count: int, valid: np.ndarray | None = None) -> np.ndarray:
    """Mask of the `count` highest valid points: the guess that needs no mechanics.

    Among equal heights the first in row order win, so the count is exact.
    """
    heights = np.asarray(heights, dtype=float)
    valid = np.ones(heights.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    places = np.flatnonzero(valid)
    if not 0 <= count <= places.size:
        raise ValueError(f"{count} highest points asked of {places.size} valid ones")
    order = np.argsort(-heights.ravel()[places], kind="stable")
    mask = np.zeros(heights.shape, dtype=bool)
    mask.ravel()[places[order[:count]]] = True
    return mask


def contact_ranking(pressure: np.ndarray, gap: np.ndarray | None = None) -> np.ndarray:
    """How likely each point is to wear by the contact solution, as a score to rank by.

    The pressure (MPa) where there is contact, minus the gap (mm) where there is none, so that a
    point nearly touched ranks above one far from it; only the order means something. Without a
    gap all points out of contact are equal.
    """
    pressure = np.asarray(pressure, dtype=float)
    outside = 0.0 if gap is None else -np.maximum(np.asarray(gap, dtype=float), 0)
    return np.where(pressure > 0, pressure, outside)


def score_patch(t0: xr.DataArray, contact: xr.Dataset, registered: xr.Dataset) -> dict[str, float]:
    """One patch's row: predicted contact and its rival against measured loss.

    Parameters
    ----------
    t0 : (y, x) xarray.DataArray
        Heights before use, mm.
    contact : xarray.Dataset
        ``pressure`` (y, x) in MPa and, for the continuous score, ``gap`` (y, x) in mm, both on
        the grid of `t0`.
    registered : xarray.Dataset
        As from `gstlib.validation.change.height_change`.

    Returns
    -------
    dict
        ``contact_fraction`` (whole patch), ``valid_contact_fraction`` (in the overlap), the items
        of `wear_summary` (its ``loss_fraction`` is the prevalence), then ``precision, recall, f1,
        iou, roc_auc`` of the prediction within the overlap, and the same with ``highest_`` in
        front for the equally many highest points.
    """
    heights = t0.values
    pressure = contact["pressure"].values
    valid = np.isfinite(registered["change"].values)
    if not heights.shape == pressure.shape == valid.shape:
        raise ValueError(
            f"T0, pressure and change have shapes {heights.shape}, {pressure.shape}, {valid.shape}"
        )
    predicted = pressure > 0
    loss = registered["loss"].values.astype(bool)
    gap = contact["gap"].values if "gap" in contact else None
    rival = highest_points(heights, int((predicted & valid).sum()), valid)
    row = {
        "contact_fraction": float(predicted.mean()),
        "valid_contact_fraction": _ratio(int((predicted & valid).sum()), int(valid.sum())),
        **wear_summary(registered),
        **mask_scores(predicted, loss, valid),
        "roc_auc": roc_auc(contact_ranking(pressure, gap), loss, valid),
    }
    rivals = mask_scores(rival, loss, valid)
    rivals["roc_auc"] = roc_auc(heights, loss, valid)
    return row | {f"highest_{name}": value for name, value in rivals.items()}


def rank_correlations(
    table: pd.DataFrame,
    *,
    generator: np.random.Generator,
    predictors: Sequence[str] = ("pressure_MPa", "contact_fraction"),
    extents: Sequence[str] = ("loss_fraction", "loss_per_area_um"),
    resamples: int = 2000,
) -> pd.DataFrame:
    """Spearman correlation over patches of each predictor with each extent of the traces.

    Parameters
    ----------
    table : pandas.DataFrame
        One row per patch; rows with a missing value are left out of that pair.
    generator : numpy.random.Generator
        Source of chance for the interval and, above 8 patches, for the p-value.
    predictors, extents : sequences of str
        Columns to pair.
    resamples : int
        Bootstrap samples of patches.

    Returns
    -------
    pandas.DataFrame
        ``statistic`` (``spearman(predictor, extent)``), ``value``, ``low`` and ``high`` (95 %
        percentile bootstrap over patches), ``p_value`` (two-sided permutation test: every pairing
        up to 8 patches, 9999 random ones beyond), ``n``. NaN with fewer than 3 patches or a
        constant column.
    """
    rows = []
    for predictor in predictors:
        for extent in extents:
            both = table[[predictor, extent]].dropna()
            x, y = both.to_numpy(dtype=float).T
            value, low, high, p_value = _spearman(x, y, generator, resamples)
            rows.append(
                {
                    "statistic": f"spearman({predictor}, {extent})",
                    "value": value,
                    "low": low,
                    "high": high,
                    "p_value": p_value,
                    "n": len(both),
                }
            )
    return pd.DataFrame(rows, columns=["statistic", "value", "low", "high", "p_value", "n"])


def _spearman(
    x: np.ndarray, y: np.ndarray, generator: np.random.Generator, resamples: int
) -> tuple[float, float, float, float]:
    """Spearman's rho, its bootstrap interval and its permutation p-value."""
    from scipy.stats import permutation_test, rankdata

    if x.size < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return (math.nan,) * 4
    ranks_x, ranks_y = rankdata(x), rankdata(y)
    value = float(_row_correlation(ranks_x, ranks_y))
    test = permutation_test(
        (ranks_x,),
        lambda shuffled, axis: _row_correlation(shuffled, ranks_y),
        permutation_type="pairings",
        n_resamples=math.factorial(_EXACT_UP_TO) if x.size <= _EXACT_UP_TO else _RANDOM_PAIRINGS,
        vectorized=True,
        rng=generator,
    )
    drawn = generator.integers(0, x.size, (resamples, x.size))
    samples = _row_correlation(rankdata(x[drawn], axis=1), rankdata(y[drawn], axis=1))
    # a draw of one patch over and over has no correlation
    low, high = np.nanquantile(samples, [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2])
    return value, float(low), float(high), float(test.pvalue)


def _row_correlation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pearson correlation along the last axis; NaN where one of them is constant."""
    a = a - a.mean(axis=-1, keepdims=True)
    b = b - b.mean(axis=-1, keepdims=True)
    scale = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
    product = (a * b).sum(axis=-1)
    return np.divide(product, scale, out=np.full(np.shape(product), np.nan), where=scale > 0)


def _masks(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    predicted, observed = np.asarray(predicted, dtype=bool), np.asarray(observed, dtype=bool)
    valid = np.ones(observed.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    if not predicted.shape == observed.shape == valid.shape:
        raise ValueError(f"masks have shapes {predicted.shape}, {observed.shape} and {valid.shape}")
    return predicted, observed, valid


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan
