"""The top of a map of correlations, and what it says of a shift."""

import math
from dataclasses import dataclass

import numpy as np

from gstlib.placement.matching import Match

__all__ = ["Peak", "best_shift", "find_peak", "shift_columns"]


# Of the spline through a map's points.
_ORDER = 5


@dataclass(frozen=True)
class Peak:
    """Top of a map of correlations: the shift (y, x) in steps, and the curvature (2, 2) there.

    `index` is the point of the map nearest to it.
    """

    value: float
    index: tuple[int, int]
    shift: np.ndarray
    curvature: np.ndarray


def find_peak(correlation: np.ndarray) -> Peak | None:
    """The top of a map (y, x), between its points; None on the map's edge, or where none agrees.

    A ridge aslant to the map's axes may be narrower than its points are apart and have its top
    some points beside the highest one: a spline through all of them finds it.
    """
    from scipy.interpolate import RectBivariateSpline
    from scipy.optimize import minimize

    # Unknown is what lies beyond straight edges: what is known is a rectangle.
    known = np.isfinite(correlation)
    along = [np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))]
    if min(map(len, along)) <= _ORDER:
        return None
    values = correlation[np.ix_(*along)]
    spline = RectBivariateSpline(*along, values, kx=_ORDER, ky=_ORDER)
    start = [
        a[i] for a, i in zip(along, np.unravel_index(values.argmax(), values.shape), strict=True)
    ]
    top = minimize(
        lambda at: -spline(*at).item(),
        start,
        jac=lambda at: [-spline(*at, dx=1).item(), -spline(*at, dy=1).item()],
        bounds=[(a[0], a[-1]) for a in along],
        options={"ftol": 0.0, "gtol": 1e-9},
    ).x
    if any(at - a[0] < 1 or a[-1] - at < 1 for at, a in zip(top, along, strict=True)):
        return None
    mixed = spline(*top, dx=1, dy=1).item()
    curvature = np.array([[spline(*top, dx=2).item(), mixed], [mixed, spline(*top, dy=2).item()]])
    value = spline(*top).item()
    if not value > 0 or not (np.linalg.eigvalsh(curvature) < 0).all():
        return None
    middle = (np.array(correlation.shape) - 1) / 2
    nearest = tuple(int(i) for i in np.rint(top))
    return Peak(min(value, 1.0), nearest, top - middle, curvature)


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
