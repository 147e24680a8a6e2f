"""Fits that several stages share: planes, least squares, a robust spread, the top of a parabola."""

from collections.abc import Sequence

import numpy as np

__all__ = [
    "MAD_TO_SIGMA",
    "least_squares",
    "planes_over",
    "residuals",
    "robust_sigma",
    "vertex",
]

# Standard deviation of normal noise over its median absolute deviation.
MAD_TO_SIGMA = 1.4826


def planes_over(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rows (3, ...) whose combinations are planes over the points (y, x)."""
    return np.stack(np.broadcast_arrays(1.0, y, x))


def residuals(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (n,) less the combination of `columns` (n, m) that is nearest to them."""
    coefficients, *_ = np.linalg.lstsq(columns, values, rcond=None)
    rest: np.ndarray = values - columns @ coefficients
    return rest


def least_squares(
    design: np.ndarray, values: np.ndarray, weight: np.ndarray | float = 1.0
) -> np.ndarray:
    """Coefficients (m,) of the rows of `design` (m, n) that best give `values` (n,).

    Examples
    --------
    >>> least_squares(np.array([[1.0, 1, 1], [0, 1, 2]]), np.array([1.0, 3, 5])).round(6)
    array([1., 2.])
    """
    weighted = design * weight
    # einsum, not a product of matrices: BLAS adds up in an order that changes from run to run
    normal = np.einsum("ik,jk->ij", weighted, design)
    right = np.einsum("ik,k->i", weighted, values)
    return np.linalg.lstsq(normal, right, rcond=None)[0]


def robust_sigma(values: np.ndarray) -> float:
    """Standard deviation of values, by their median absolute deviation."""
    deviations = np.abs(values - np.median(values))
    return MAD_TO_SIGMA * float(np.median(deviations))


def vertex(values: Sequence[float] | np.ndarray, step: float) -> float:
    """How far the vertex of a parabola through three values, a `step` apart, is from the second.

    >>> vertex([0.0, 3.0, 4.0], step=2.0)
    2.0
    """
    before, top, after = values
    bend = before - 2 * top + after
    return step * (before - after) / (2 * bend or 1)
