"""Do two numbers go together over the patches, when neighbouring patches are alike?

Exchanging patches, or counting them, takes each for a trial of its own. Where both numbers vary
smoothly over the stone, patches beside each other repeat each other, and such a test finds
relations that are not there more often than its level says. Dutilleul (1993, Biometrics 49:305)
tests a correlation with as many trials as the two autocorrelations leave, after Clifford,
Richardson and Hémon (1989, Biometrics 45:123).
"""

import math

import numpy as np
from scipy.spatial.distance import pdist, squareform
from scipy.stats import rankdata, t

__all__ = ["effective_patches", "neighbours_p_value"]

# Fewer have no degree of freedom for Student's t.
_FEWEST = 3.0


def neighbours_p_value(
    x: np.ndarray, y: np.ndarray, places: np.ndarray, *, exchanged: float
) -> float:
    """P-value of Spearman's correlation over patches, neighbours allowed for.

    Parameters
    ----------
    x, y : (n,) array_like
        Two numbers of each patch.
    places : (n, 2) array_like
        Where the patches lie, in any unit.
    exchanged : float
        P-value when patches are exchanged, exact where they are unrelated. The test here rests on
        Student's t, which is too sure of few ranks, and can only weaken the evidence: where it
        gives less, this one stands.

    Returns
    -------
    float
        Two-sided. NaN with fewer than 4 patches or a constant number.
    """
    x, y = rankdata(x), rankdata(y)
    if x.size < 4 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return math.nan
    freedom = max(effective_patches(x, y, places), _FEWEST) - 2
    correlation = float(np.clip(np.corrcoef(x, y)[0, 1], -1, 1))
    spread = math.sqrt((1 - correlation**2) / freedom)
    allowed = float(2 * t.sf(abs(correlation) / spread, freedom)) if spread > 0 else 0.0
    return max(exchanged, allowed)


def effective_patches(x: np.ndarray, y: np.ndarray, places: np.ndarray) -> float:
    """How many independent patches have the same variance of a correlation as these.

    At most as many as there are: neighbours that differ more than others do are not taken for
    further evidence.
    """
    distance = squareform(pdist(np.asarray(places, dtype=float)))
    count = len(distance)
    centring = np.eye(count) - 1 / count
    of_x, of_y = (
        centring @ _covariance(np.asarray(values, dtype=float), distance) @ centring
        for values in (x, y)
    )
    variance = np.trace(of_x @ of_y) / (np.trace(of_x) * np.trace(of_y))
    return float(min(count, 1 + 1 / variance)) if variance > 0 else float(count)


def _covariance(values: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Covariance of every pair of patches, by their distance; 0 for those far from each other."""
    # ASSUME: covariances are estimated in classes as wide as neighbours are apart, up to half of
    # the largest distance, as is usual for variograms; beyond it patches count as unrelated.
    apart = np.where(np.eye(len(distance), dtype=bool), np.inf, distance)
    step = float(np.median(apart.min(axis=1)))
    # rounded: on a lattice distances lie at the edges of classes, and the unit must not matter
    steps = np.round(distance / step, 9)
    number = np.maximum(np.rint(steps), 1)
    number[(number + 0.5 > steps.max() / 2) | np.isinf(apart)] = 0
    centred = values - values.mean()
    products = np.multiply.outer(centred, centred)
    covariance = np.diag(np.diag(products).mean() * np.ones(len(values)))
    for one in np.unique(number[number > 0]):
        covariance[number == one] = products[number == one].mean()
    return covariance
