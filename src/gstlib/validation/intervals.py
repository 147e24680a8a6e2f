"""Intervals from resampling few units: patches of a stone, blocks of a patch."""

import math

import numpy as np

__all__ = ["CONFIDENCE", "FEWEST_UNITS", "percentile_interval"]

CONFIDENCE = 0.95
# Resamples lie between the least and the greatest of n units, which hold the truth between them in
# 1 - 2 / 2ⁿ of cases: with fewer units there is no interval at this confidence.
FEWEST_UNITS = 6


def percentile_interval(samples: np.ndarray, units: int) -> tuple[float, float]:
    """Bootstrap percentile interval at 95 %, widened for the number of units resampled.

    The plain percentiles of a mean are those of a normal distribution with the spread divided by
    n, not n - 1; with a dozen units they hold the truth in some 90 % of cases, not 95. Taken
    further out, at the tails that make them Student's interval for a mean, they come close to what
    they claim (Hesterberg 2015, Am. Stat. 69:371).

    Parameters
    ----------
    samples : array_like
        The statistic of every resample; NaN where it is not defined.
    units : int
        How many units each resample draws.

    Returns
    -------
    low, high : float
        NaN with fewer units than `FEWEST_UNITS`, or if the statistic is never defined.
    """
    from scipy.stats import norm, t

    samples = np.asarray(samples, dtype=float)
    samples = samples[np.isfinite(samples)]
    if units < FEWEST_UNITS or not samples.size:
        return math.nan, math.nan
    tail = norm.cdf(t.ppf((1 - CONFIDENCE) / 2, units - 1) * math.sqrt(units / (units - 1)))
    low, high = np.quantile(samples, [tail, 1 - tail])
    return float(low), float(high)
