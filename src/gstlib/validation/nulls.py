"""How well would a prediction agree by chance? The same map, shifted over the patch.

Wear and contact both come in clusters, so points are not independent trials, and a test that treats
them as such finds significance everywhere. The null model keeps both textures and breaks only
their alignment: the prediction is shifted over the patch as over a torus, and scored where T1
covers T0 (the torus-translation test of ecology: Harms et al. 2001, J. Ecol. 89:947). Sums over
the points for all shifts at once are circular cross-correlations, computed by FFT.

A map that leaves the patch at one edge re-enters at the opposite edge. This breaks waves as long as
the patch: they agree less, in either direction, than they can in place. The variance of the
agreement of two unrelated fields follows from their autocorrelations (Clifford, Richardson and
Hémon 1989, Biometrics 45:123). Taken with and without the wrap-around, it gives the factor by which
the scores of the shifts spread too little.

Limits: both maps are assumed to have the same statistics all over the patch, which a ramp of wear
from one side to the other would violate; and a patch only a few correlation lengths wide has few
independent shifts. If the loss correlates farther than `LONGEST`, shifts claim too much.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy

from gstlib.validation.agreement import mask_scores

__all__ = ["LONGEST", "correlation_length", "p_value", "shifted_mcc"]

# ASSUME: the correlation length is where the autocorrelation, averaged over all directions, has
# fallen to 1/e. Shifts beyond that of the loss count as chance: on random fields with one
# correlation length, tests with them reject as often as their level says.
_DECAYED = math.exp(-1)
# ASSUME: autocorrelations are used up to half the patch's shorter side: few pairs of points are
# farther apart, and their mean product is uncertain.
_FARTHEST = 0.5
# ASSUME: a loss that correlates farther than this share of the patch's shorter side is not tested
# by shifts. On pairs of unrelated, levelled self-affine maps, MCC at the level of 5 % claims a
# relation in 5.8 % of the pairs up to it, in 7.9 % beyond it (benchmarks/chance.py). A shorter
# limit lowers the rate, and leaves many patches that wear by Archard's law untested.
LONGEST = 0.08
# Scores of the same counts may differ by rounding; they are ties.
_TIE = 1e-9


def shifted_mcc(
    mask: np.ndarray,
    loss: np.ndarray,
    valid: np.ndarray,
    spacing: Sequence[float],
    *,
    beyond_mm: float,
    shifts: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """MCC of a predicted mask (ny, nx) with the loss, shifted over the patch: (1 + shifts,).

    The shifts are all different and longer than `beyond_mm`, the correlation length of the loss (if
    NaN, without loss, any length); a small patch may have fewer. The first value is without a
    shift. The others, if above their mean, are stretched away from it by the wrap-around factor.
    Those below stay: if most shifts hit nothing, a patch that also hits nothing would otherwise
    seem better than they are. `loss` is where height was lost, of the `valid` points.
    """
    far = np.argwhere(_torus_distance(valid.shape, spacing) > np.nan_to_num(beyond_mm))
    if len(far) > shifts:
        far = far[np.sort(generator.choice(len(far), shifts, replace=False))]
    rows, columns = np.vstack([[0, 0], far]).T
    spectrum = np.conj(scipy.fft.rfft2(1.0 * mask))
    hits, predicted = (
        np.rint(scipy.fft.irfft2(spectrum * scipy.fft.rfft2(1.0 * fixed), mask.shape))
        for fixed in (loss, valid)
    )
    counts = hits[rows, columns], predicted[rows, columns], loss.sum(), valid.sum()
    found = mask_scores(*counts)["mcc"]
    # ASSUME: the wrap-around narrows MCC as it narrows the sum of products behind it.
    factor = _wrap_around_factor(mask, loss, valid)
    mean = found[1:].mean() if len(far) else math.nan
    found[1:] += (factor - 1) * np.maximum(found[1:] - mean, 0)
    return found


def correlation_length(field: np.ndarray, valid: np.ndarray, spacing: Sequence[float]) -> float:
    """Distance (mm) at which the autocorrelation of a field, over all directions, falls to 1/e.

    Linearly interpolated; infinite if it does not fall so low within half of the field (ny, nx),
    NaN for a constant field.
    """
    centred = _centred(field, valid)
    if not centred.any():
        return math.nan
    pairs = np.rint(_lagged_products(valid.astype(float)))
    distance = _torus_distance(pairs.shape, spacing)
    step = max(spacing)
    longest = min(n * d for n, d in zip(valid.shape, spacing, strict=True)) / 2
    near = (distance <= longest) & (pairs > 0)
    ring = np.rint(distance[near] / step).astype(int)
    products = np.bincount(ring, weights=_lagged_products(centred)[near])
    mean = products / np.bincount(ring, weights=pairs[near])
    correlation = mean / mean[0]
    low = np.flatnonzero(correlation < _DECAYED)
    if not low.size:
        return math.inf
    before, after = correlation[low[0] - 1 : low[0] + 1]
    return float((low[0] - 1 + (before - _DECAYED) / (before - after)) * step)


def p_value(value: float, null: np.ndarray) -> float:
    """Share of the null's scores that reach the value, which itself counts as one of them.

    NaN without a value or a null; shifts without a defined score are left out.
    """
    null = null[np.isfinite(null)]
    if math.isnan(value) or not null.size:
        return math.nan
    return float((1 + (null >= value - _TIE).sum()) / (1 + null.size))


def _wrap_around_factor(moved: np.ndarray, fixed: np.ndarray, valid: np.ndarray) -> float:
    """By how much wrap-around narrows the sum of products of a shifted field with a fixed one.

    For `moved` (known everywhere) and `fixed` (known where valid): the standard deviation of the
    sum of products without wrap-around over that with it; at least 1.
    """
    fixed, moved = _centred(fixed, valid), moved - np.mean(moved)
    products = np.conj(scipy.fft.rfft2(moved)) * scipy.fft.rfft2(fixed)
    on_torus = float(scipy.fft.irfft2(products, valid.shape).std())
    if not (fixed.any() and on_torus > 0):
        return 1.0
    of_fixed = _lagged_products(fixed)
    near = _torus_distance(of_fixed.shape, (1, 1)) <= _FARTHEST * min(valid.shape)
    lags = [np.minimum(np.arange(n), n - np.arange(n)) for n in of_fixed.shape]
    pairs = np.outer(
        *(np.maximum(n - lag, 0) for n, lag in zip(valid.shape, lags, strict=True))
    )
    weight = of_fixed[near] / pairs[near]
    in_place = math.sqrt(max(float((_lagged_products(moved)[near] * weight).sum()), 0.0))
    return max(1.0, in_place / on_torus)


def _centred(field: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """The field minus its mean over the valid points; 0 where it is unknown."""
    return (
        np.where(valid, field - field[valid].mean(), 0)
        if valid.any()
        else np.zeros(field.shape)
    )


def _lagged_products(field: np.ndarray) -> np.ndarray:
    """Sum of the products of all pairs of points at each lag, without wrap-around."""
    shape = [scipy.fft.next_fast_len(2 * n, real=True) for n in field.shape]
    return scipy.fft.irfft2(np.abs(scipy.fft.rfft2(field, shape)) ** 2, shape)


def _torus_distance(shape: Sequence[int], spacing: Sequence[float]) -> np.ndarray:
    """Length (mm) of every shift over a torus."""
    y, x = (
        np.minimum(np.arange(n), n - np.arange(n)) * step
        for n, step in zip(shape, spacing, strict=True)
    )
    return np.hypot(y[:, None], x[None, :])
