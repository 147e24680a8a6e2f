"""How well would a prediction agree by chance? The same map, laid elsewhere on the patch.

Wear and contact both come in patches, so that points are no independent trials and a test that
takes them for such finds significance everywhere. The null keeps both textures and breaks only
their alignment: the prediction is shifted over the patch as over a torus, what leaves at one edge
coming in at the other, and scored where T1 lies over T0 (as the torus-translation test of ecology:
Harms et al. 2001, J. Ecol. 89:947). Sums over the points for all shifts at once are circular
cross-correlations, by FFT.

Limits: the wrapped edge is a seam that no surface has; both maps are taken to have the same
statistics all over the patch, which a ramp of wear from one side to the other would break; and a
patch a few autocorrelation lengths wide has few placements that differ.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy.fft

from gstlib.validation.scores import (
    fractions_skill_of_sums,
    mask_scores_of_counts,
    rank_scores_of_counts,
)

__all__ = [
    "correlation_length",
    "draw_shifts",
    "levels_of",
    "p_value",
    "shifted_fractions_skill",
    "shifted_mask_scores",
    "shifted_rank_scores",
]

# ASSUME: the autocorrelation length is where the autocorrelation, averaged over all directions, has
# fallen to 1/e. Shifts further than that of the loss are chance: tests with them claim as often as
# they say on random fields with one correlation length.
_GONE = math.exp(-1)
# Scores of the same counts may differ by rounding; they are ties.
_TIE = 1e-9


def correlation_length(field: np.ndarray, valid: np.ndarray, spacing: Sequence[float]) -> float:
    """Distance (mm) at which the autocorrelation of a field, over all directions, falls to 1/e.

    Parameters
    ----------
    field : (ny, nx) array_like
    valid : (ny, nx) array_like of bool
        Where the field is known.
    spacing : (dy, dx)
        mm.

    Returns
    -------
    float
        Linearly interpolated; infinite if it never falls so low within half of the field, NaN for
        a constant field.
    """
    valid = np.asarray(valid, dtype=bool)
    field = np.where(valid, np.asarray(field, dtype=float), 0)
    centred = np.where(valid, field - field[valid].mean(), 0) if valid.any() else field
    if not centred.any():
        return math.nan
    shape = [scipy.fft.next_fast_len(2 * n, real=True) for n in field.shape]

    def autocorrelation(values: np.ndarray) -> np.ndarray:
        return scipy.fft.irfft2(np.abs(scipy.fft.rfft2(values, shape)) ** 2, shape)

    pairs = np.rint(autocorrelation(valid.astype(float)))
    distance = _distance(shape, spacing)
    step = max(spacing)
    near = (distance <= min(n * d for n, d in zip(field.shape, spacing, strict=True)) / 2) & (
        pairs > 0
    )
    ring = np.rint(distance[near] / step).astype(int)
    products = np.bincount(ring, weights=autocorrelation(centred)[near])
    mean = products / np.bincount(ring, weights=pairs[near])
    correlation = mean / mean[0]
    low = np.flatnonzero(correlation < _GONE)
    if not low.size:
        return math.inf
    first = low[0]
    before, after = correlation[first - 1 : first + 1]
    return float((first - 1 + (before - _GONE) / (before - after)) * step)


def draw_shifts(
    shape: Sequence[int],
    spacing: Sequence[float],
    *,
    beyond: float,
    count: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Random shifts over the torus, further than `beyond` (mm) from no shift, none twice.

    Returns
    -------
    (n, 2) ndarray of int
        Shifts (y, x) in elements; all there are if these are fewer than `count`.
    """
    far = np.argwhere(_distance(shape, spacing) > beyond)
    if len(far) <= count:
        return far
    return far[np.sort(generator.choice(len(far), count, replace=False))]


def shifted_mask_scores(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray, shifts: np.ndarray
) -> dict[str, np.ndarray]:
    """Mask scores of a prediction laid elsewhere.

    Parameters
    ----------
    predicted, observed, valid : (ny, nx) array_like of bool
        The prediction, known everywhere; what was seen, and where.
    shifts : (n, 2) array_like of int
        Where to lay the prediction, in elements (y, x).

    Returns
    -------
    dict
        For each score the values over the shifts, shape (n,).
    """
    observed, valid = np.asarray(observed, dtype=bool), np.asarray(valid, dtype=bool)
    seen = observed & valid
    hits, marked = np.rint(_sums_over_shifts(predicted, [seen, valid], shifts))
    return mask_scores_of_counts(hits, marked, seen.sum(), valid.sum())


def shifted_fractions_skill(
    predicted: np.ndarray, observed: np.ndarray, valid: np.ndarray, shifts: np.ndarray
) -> np.ndarray:
    """Fractions skill of a prediction laid elsewhere.

    Parameters
    ----------
    predicted, observed : (ny, nx) array_like
        Shares of the window around each point, as from `gstlib.validation.scores.fractions`.
    valid : (ny, nx) array_like of bool
        Where to compare.
    shifts : (n, 2) array_like of int
        Where to lay the prediction, in elements (y, x).

    Returns
    -------
    (n,) ndarray
    """
    observed = np.where(valid, observed, 0)
    (product,) = _sums_over_shifts(predicted, [observed], shifts)
    (squares,) = _sums_over_shifts(np.square(predicted), [valid], shifts)
    return fractions_skill_of_sums(product, squares, np.square(observed).sum())


def shifted_rank_scores(
    levels: np.ndarray, observed: np.ndarray, valid: np.ndarray, shifts: np.ndarray
) -> dict[str, np.ndarray]:
    """Rank scores of a ranking laid elsewhere.

    Parameters
    ----------
    levels : (ny, nx) array_like of int
        The ranking in levels, 0 the highest, as from `levels_of`.
    observed, valid : (ny, nx) array_like of bool
        What was seen, and where.
    shifts : (n, 2) array_like of int
        Where to lay the ranking, in elements (y, x).

    Returns
    -------
    dict
        For each score the values over the shifts, shape (n,).
    """
    levels = np.asarray(levels)
    observed, valid = np.asarray(observed, dtype=bool), np.asarray(valid, dtype=bool)
    # single precision: what is summed are whole numbers, far below its 7 digits
    spectra = [_spectrum(mask.astype(np.float32)) for mask in (observed & valid, valid)]
    counts = np.empty((2, len(shifts), int(levels.max()) + 1))
    for level in range(counts.shape[-1]):
        counts[..., level] = _sums_over_shifts(
            (levels == level).astype(np.float32), spectra, shifts
        )
    events, points = np.rint(counts)
    return rank_scores_of_counts(events, points - events)


def levels_of(ranking: np.ndarray, count: int) -> np.ndarray:
    """A ranking in about so many levels, 0 the highest, finer towards the top.

    Half of the levels divide the highest tenth of the points, in equal steps of the logarithm of
    the share above, the rest divides the others evenly: average precision is decided at the top.
    """
    ranking = np.asarray(ranking, dtype=float)
    top = np.geomspace(10 / ranking.size, 0.1, count // 2, endpoint=False)
    shares = np.r_[top, np.linspace(0.1, 1, count - count // 2, endpoint=False)]
    edges = np.unique(np.quantile(ranking, 1 - shares))
    return edges.size - np.searchsorted(edges, ranking, side="right")


def p_value(value: float, null: np.ndarray) -> float:
    """Share of the null's scores that reach the value, which counts as one of them.

    NaN without a value or a null; shifts at which the score is not defined are left out.
    """
    null = np.asarray(null, dtype=float)
    null = null[np.isfinite(null)]
    if math.isnan(value) or not null.size:
        return math.nan
    return float((1 + (null >= value - _TIE).sum()) / (1 + null.size))


def _distance(shape: Sequence[int], spacing: Sequence[float]) -> np.ndarray:
    """Distance (mm) of every shift over a torus from no shift."""
    y, x = (
        np.minimum(np.arange(n), n - np.arange(n)) * step
        for n, step in zip(shape, spacing, strict=True)
    )
    return np.hypot(y[:, None], x[None, :])


def _spectrum(field: np.ndarray) -> np.ndarray:
    return scipy.fft.rfft2(field if field.dtype == np.float32 else field.astype(float))


def _sums_over_shifts(
    moved: np.ndarray, fixed: Sequence[np.ndarray], shifts: np.ndarray
) -> np.ndarray:
    """Sums over the points of `moved`, shifted, times each of `fixed`: (fixed, shifts).

    `fixed` holds fields or their spectra.
    """
    turned = np.conj(_spectrum(moved))
    rows, columns = np.asarray(shifts).T
    return np.stack(
        [
            scipy.fft.irfft2(
                turned * (field if np.iscomplexobj(field) else _spectrum(field)), moved.shape
            )[rows, columns]
            for field in fixed
        ]
    )
