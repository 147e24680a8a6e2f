"""Uncertainty of a statistic over patches: intervals resample the patches, tests permute them.

Permutations treat each patch as an independent trial. If two numbers vary smoothly over the stone,
adjacent patches repeat each other. Such a test then finds non-existent relations more often than
its level. Dutilleul (1993, Biometrics 49:305) reduces the number of trials by both
autocorrelations, after Clifford, Richardson and Hémon (1989, Biometrics 45:123).
"""

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from gstlib.validation.masks import ratio

__all__ = [
    "Draws",
    "Estimate",
    "exchange_p_value",
    "mean_of",
    "percentile_interval",
    "rank_correlation",
    "ratio_of_sums",
    "spatial_p_value",
]

_CONFIDENCE = 0.95
# Resamples of n units lie between the smallest and the largest unit, which enclose the truth in 1 -
# 2 / 2ⁿ of cases. Fewer units than this do not allow an interval at this confidence.
_FEWEST_UNITS = 6
# All pairings are tried for up to this many patches (8! = 40320), and a random sample of them
# beyond. All signs of a difference are tried up to 13 patches (2¹³ = 8192).
_EXACT_UP_TO = 8
_RANDOM = 9999
# Student's t requires a degree of freedom.
_FEWEST_EFFECTIVE = 3.0


class Draws(NamedTuple):
    """Random generator and number of resamples for statistics.

    Attributes
    ----------
    generator : numpy.random.Generator
    resamples : int
        Bootstrap samples of patches.
    """

    generator: np.random.Generator
    resamples: int


class Estimate(NamedTuple):
    """A statistic over `n` patches, its 95 % interval and the p-value of a test; NaN for none."""

    value: float
    low: float
    high: float
    p_value: float
    n: int


def mean_of(values: np.ndarray, draws: Draws, p_value: float = math.nan) -> Estimate:
    """Mean over the patches of values (patches,), with its interval."""
    return ratio_of_sums(values, np.ones(len(values)), draws, p_value)


def ratio_of_sums(
    part: np.ndarray, whole: np.ndarray, draws: Draws, p_value: float = math.nan
) -> Estimate:
    """Ratio of the sums over the patches of two quantities (patches,), with its interval."""
    part, whole = np.asarray(part), np.asarray(whole)
    count = len(part)
    drawn = draws.generator.integers(0, max(count, 1), (draws.resamples, count))
    samples = ratio(part[drawn].sum(axis=1), whole[drawn].sum(axis=1))
    interval = percentile_interval(samples, count)
    value = float(ratio(part.sum(), whole.sum()))
    return Estimate(value, *interval, p_value, count)


def percentile_interval(samples: np.ndarray, units: int) -> tuple[float, float]:
    """Bootstrap percentile interval at 95 %, widened for the number of units resampled.

    The plain percentiles of a mean belong to a normal distribution whose spread is divided by n,
    not n - 1. With a dozen units, they enclose the truth in some 90 % of cases, not 95. Here, they
    are taken at the tails that give Student's interval for a mean. This brings them close to their
    nominal level (Hesterberg 2015, Am. Stat. 69:371). NaN samples are left out. The interval is NaN
    with fewer than 6 units, or if the statistic is never defined.
    """
    samples = samples[np.isfinite(samples)]
    if units < _FEWEST_UNITS or not samples.size:
        return math.nan, math.nan
    student = scipy.special.stdtrit(units - 1, (1 - _CONFIDENCE) / 2)
    tail = scipy.special.ndtr(student * math.sqrt(units / (units - 1)))
    low, high = np.quantile(samples, [tail, 1 - tail])
    return float(low), float(high)


def exchange_p_value(gain: np.ndarray, generator: np.random.Generator) -> float:
    """Two-sided test of a mean gain, shape (patches,), by exchanging model and baseline per patch.

    The p-value is NaN for a single patch, or if all gains are zero.
    """
    if len(gain) < 2 or not np.any(gain):
        return math.nan
    # "samples" of one gain each: an exchange changes its sign.
    test = scipy.stats.permutation_test(
        (gain,), np.mean, permutation_type="samples", n_resamples=_RANDOM, rng=generator
    )
    return float(test.pvalue)


def rank_correlation(
    table: pd.DataFrame, predictor: str, extent: str, draws: Draws
) -> Estimate:
    """Spearman's correlation over patches between a predictor and an extent of the traces.

    `table` has a row for each patch, with its position ``x_mm, y_mm``; rows with a missing value
    are left out. The interval is a 95 % bootstrap over patches. The two-sided permutation test uses
    every pairing up to 8 patches and 9999 random pairings beyond. It accounts for spatial
    autocorrelation (`spatial_p_value`). The estimate is NaN with fewer than 3 patches or a constant
    column.
    """
    complete = table[[predictor, extent, "x_mm", "y_mm"]].dropna()
    x, y, *places = complete.to_numpy(dtype=float).T
    if x.size < 3 or not (np.ptp(x) > 0 and np.ptp(y) > 0):
        return Estimate(*(math.nan,) * 4, x.size)
    p = scipy.stats.permutation_test(
        (x,),
        lambda shuffled, axis: _spearman(shuffled, y),
        permutation_type="pairings",
        n_resamples=math.factorial(_EXACT_UP_TO) if x.size <= _EXACT_UP_TO else _RANDOM,
        vectorized=True,
        rng=draws.generator,
    ).pvalue
    drawn = draws.generator.integers(0, x.size, (draws.resamples, x.size))
    # A draw that repeats a single patch does not have a correlation.
    interval = percentile_interval(_spearman(x[drawn], y[drawn]), x.size)
    p = spatial_p_value(x, y, np.transpose(places), permuted=float(p))
    return Estimate(float(_spearman(x, y)), *interval, p, x.size)


def spatial_p_value(
    x: np.ndarray, y: np.ndarray, places: np.ndarray, *, permuted: float
) -> float:
    """P-value of Spearman's correlation over patches, corrected for spatial autocorrelation.

    `permuted` is the p-value of the permutation test, exact for unrelated patches. Dutilleul's test
    uses Student's t, which is overconfident with few ranks. So the larger of the two p-values
    counts. The test is two-sided; the p-value is NaN with fewer than 4 patches.
    `places` (n, 2) are the coordinates of the patches, in any unit.
    """
    if x.size < 4:
        return math.nan
    x, y = scipy.stats.rankdata([x, y], axis=1)
    freedom = max(_effective_patches(x, y, places), _FEWEST_EFFECTIVE) - 2
    correlation = float(np.clip(np.corrcoef(x, y)[0, 1], -1, 1))
    spread = math.sqrt((1 - correlation**2) / freedom)
    if not spread > 0:
        return permuted
    spatial = 2 * scipy.stats.t.sf(abs(correlation) / spread, freedom)
    return max(permuted, float(spatial))


def _effective_patches(x: np.ndarray, y: np.ndarray, places: np.ndarray) -> float:
    """Number of independent patches whose correlation would have the same variance.

    It is at most the actual number, because differences between neighbours do not add evidence.
    """
    distance = scipy.spatial.distance.cdist(places, places)
    count = len(distance)
    centring = np.eye(count) - 1 / count
    of_x, of_y = (
        centring @ _covariance(values, distance) @ centring for values in (x, y)
    )
    variance = np.trace(of_x @ of_y) / (np.trace(of_x) * np.trace(of_y))
    return min(count, 1 + 1 / float(variance)) if variance > 0 else count


def _covariance(values: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Covariance of every pair of patches by their distance; 0 for distant pairs."""
    # ASSUME: Classes of distance for covariances. The classes are as wide as the distance of
    # neighbours, up to half of the largest distance; pairs beyond it count as unrelated. Reason:
    # This is usual for variograms. Patches at one place are a class of their own, here 0.5.
    is_self = np.eye(len(distance), dtype=bool)
    nearest = np.where(distance > 0, distance, np.inf).min(axis=1)
    step = float(np.median(nearest[np.isfinite(nearest)])) if distance.any() else 1.0
    # Rounded, because on a lattice distances fall on the edges of classes, and the unit must not
    # matter.
    steps = np.round(distance / step, 9)
    number = np.where(distance > 0, np.maximum(np.rint(steps), 1), 0.5)
    is_far = (distance > 0) & (number + 0.5 > steps.max() / 2)
    number[is_far | is_self] = 0
    centred = values - values.mean()
    products = np.multiply.outer(centred, centred)
    covariance = np.diag(products).mean() * np.eye(len(values))
    for one in np.unique(number[number > 0]):
        covariance[number == one] = products[number == one].mean()
    return covariance


def _spearman(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Spearman's correlation along the last axis; NaN if one of them is constant."""
    middle = (x.shape[-1] + 1) / 2
    x, y = (scipy.stats.rankdata(values, axis=-1) - middle for values in (x, y))
    squares = (x**2).sum(axis=-1) * (y**2).sum(axis=-1)
    return ratio((x * y).sum(axis=-1), np.sqrt(squares))
