"""The top of a map of correlations, and what it says of a shift."""

import math
from dataclasses import dataclass

import numpy as np

from gstlib.placement.matching import Match

__all__ = ["Peak", "best_shift", "find_peak", "shift_columns"]


@dataclass(frozen=True)
class Peak:
    """Top of a map of correlations: the shift (y, x) in steps, and the curvature (2, 2) there."""

    value: float
    index: tuple[int, int]
    shift: np.ndarray
    curvature: np.ndarray


def find_peak(correlation: np.ndarray) -> Peak | None:
    """The top of a map (y, x), between its points; None on the map's edge, or where none agrees."""
    row, column = np.unravel_index(np.nanargmax(correlation), correlation.shape)
    around = correlation[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
    if around.shape != (3, 3) or not np.isfinite(around).all() or not around[1, 1] > 0:
        return None
    slope = np.array([_slope(correlation[:, column], row), _slope(correlation[row], column)])
    mixed = (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0]) / 4
    curvature = np.array(
        [
            [around[2, 1] - 2 * around[1, 1] + around[0, 1], mixed],
            [mixed, around[1, 2] - 2 * around[1, 1] + around[1, 0]],
        ]
    )
    if not (np.linalg.eigvalsh(curvature) < 0).all():
        return None
    beside = np.clip(-np.linalg.solve(curvature, slope), -1, 1)
    value = around[1, 1] + slope @ beside / 2
    middle = (np.array(correlation.shape) - 1) / 2
    return Peak(
        float(min(value, 1.0)), (row, column), np.array([row, column]) + beside - middle, curvature
    )


def _slope(values: np.ndarray, at: int) -> float:
    """Slope there, to the fourth order where four neighbours are known: peaks are lopsided."""
    near = (values[at + 1] - values[at - 1]) / 2
    if not 2 <= at < len(values) - 2:
        return near
    far = (values[at + 2] - values[at - 2]) / 4
    return (4 * near - far) / 3 if np.isfinite(far) else near


def best_shift(match: Match, peak: Peak, noise: float, free: int, step_um: float) -> dict:
    """Best shift, its standard error and the test of no shift.

    With heights of any factor, the squares that a shift leaves are those of the patch less the
    share ρ² that the macroscale accounts for; their curvature gives the covariance.
    """
    from scipy.stats import f as f_distribution

    covariance = -noise * np.linalg.inv(match.energy * peak.value * peak.curvature)
    reach = match.correlation.shape[1] // 2
    nominal = max(float(match.correlation[0, reach, reach]), 0.0)
    gained = match.energy * (peak.value**2 - nominal**2)
    ratio = gained / 2 / noise if noise > 0 else math.inf
    return shift_columns(
        peak.shift * step_um, covariance * step_um**2, f_distribution.sf(ratio, 2, free)
    )


def shift_columns(shift: np.ndarray, covariance: np.ndarray, p_value: float) -> dict:
    error = np.sqrt(np.diag(covariance))
    return {
        "shift_x_um": float(shift[1]),
        "shift_y_um": float(shift[0]),
        "shift_x_error_um": float(error[1]),
        "shift_y_error_um": float(error[0]),
        "shift_p_value": float(p_value),
    }
