"""What all patches together say: of a shift that they share, and of how the mould was undone."""

import numpy as np

from gstlib.placement.matching import DRAWS, STRIDE, Match
from gstlib.placement.peaks import find_peak, shift_columns
from gstlib.placement.rows import ALL, new_row, verdict_of
from gstlib.placement.waves import VARIANTS

__all__ = ["shared_shift"]

# Fewer patches have no scatter to judge a shift that they share by.
_FEWEST_PATCHES = 4


def shared_shift(matches: list[Match], waves: int, step_um: float, significance: float) -> dict:
    """The row of a shift that all patches share, and whether they fit better turned about."""
    from scipy.stats import f as f_distribution

    row = new_row(ALL, waves)
    used = [match for match in matches if match.chance is not None]
    if not used:
        return row
    windows = np.array([match.correlation for match in used])
    mean = windows.mean(axis=0)
    highest = np.mean([match.chance for match in used], axis=0).max(axis=(1, 2))
    p_values = [
        (1 + (highest >= one[::STRIDE, ::STRIDE].max()).sum()) / (1 + DRAWS) for one in mean
    ]
    reach = mean.shape[1] // 2
    row |= {
        "correlation_nominal": float(mean[0, reach, reach]),
        "correlation": float(mean[0].max()),
        "p_value": p_values[0],
    }
    peak = find_peak(mean[0])
    if peak is not None:
        row["correlation"] = peak.value
        number = len(used)
        if number >= _FEWEST_PATCHES:
            # The patches' own shifts scatter: the error follows from how their slopes do.
            slopes = np.array([[g[peak.index] for g in np.gradient(one)] for one in windows[:, 0]])
            bread = np.linalg.inv(peak.curvature)
            covariance = bread @ np.cov(slopes.T) @ bread / number
            ratio = peak.shift @ np.linalg.solve(covariance, peak.shift)
            ratio *= (number - 2) / (2 * (number - 1))
            row |= shift_columns(
                peak.shift * step_um,
                covariance * step_um**2,
                f_distribution.sf(ratio, 2, number - 2),
            )
    row["verdict"] = verdict_of(row, significance)
    row["looks"] = _looks(windows, mean, p_values, waves, significance)
    return row


def _looks(
    windows: np.ndarray,
    mean: np.ndarray,
    p_values: list[float],
    waves: int,
    significance: float,
) -> str:
    """Which variant the patches fit; empty where that is not clear."""
    from scipy.stats import f as f_distribution

    left = []
    for variant, one in enumerate(mean):
        row, column = np.unravel_index(one.argmax(), one.shape)
        left.append(1 - np.clip(windows[:, variant, row, column], 0, 1) ** 2)
    names = list(VARIANTS)
    best = int(mean.max(axis=(1, 2)).argmax())
    if best == 0:
        return names[0] if p_values[0] < significance else ""
    # It must not be one of many by chance, and must leave clearly less than the given one.
    by_chance = p_values[best] >= significance / (len(names) - 1)
    free = len(left[best]) * (waves - 3)
    better = left[0].mean() / left[best].mean() > f_distribution.isf(significance, free, free)
    return names[best] if better and not by_chance else ""
