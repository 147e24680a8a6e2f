"""Guesses of where a patch wears: the contact solution, and rivals that need no mechanics.

A prediction earns its cost only by what it adds to what a look at the surface tells. The rivals
know the heights before use and, so that the comparison is fair, how large the contact is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.ndimage

from gstlib.validation.scores import fractions

__all__ = [
    "RIVALS",
    "Prediction",
    "contact_ranking",
    "highest_points",
    "mean_curvature",
    "predictions",
    "rigid_interpenetration",
]

RIVALS = "highest", "rigid", "curvature"


@dataclass(frozen=True)
class Prediction:
    """Where wear is expected, and how much it is expected everywhere.

    Attributes
    ----------
    mask : (ny, nx) ndarray of bool
        Where wear is expected.
    shares : (ny, nx) ndarray
        Share of the window around each point that the mask marks.
    ranking : (ny, nx) ndarray, optional
        Larger where wear is likelier; None where another prediction ranks the points the same.
    """

    mask: np.ndarray
    shares: np.ndarray
    ranking: np.ndarray | None


def predictions(
    heights: np.ndarray,
    pressure: np.ndarray,
    gap: np.ndarray | None,
    valid: np.ndarray,
    *,
    spacing: Sequence[float],
    displacement: float,
    curvature_length: float,
    window: int,
) -> dict[str, Prediction]:
    """The contact solution of a patch and its rivals.

    Parameters
    ----------
    heights : (ny, nx) ndarray
        What touches the flat, mm: the patch before use, or its sum with the counterface.
    pressure, gap : (ny, nx) ndarray
        MPa and mm; the gap may be missing.
    valid : (ny, nx) ndarray of bool
        Where the patch was measured at both times: areas are equal there.
    spacing : (dy, dx)
        mm.
    displacement : float
        Far-field displacement from first touch, mm.
    curvature_length : float
        Standard deviation (mm) of the Gaussian that smooths the surface before its curvature.
    window : int
        Odd side, in elements, of the window for `Prediction.shares`.

    Returns
    -------
    dict
        ``contact``: p > 0, ranked by `contact_ranking`. ``highest``: the highest points, as many
        as are in contact, ranked by height. ``rigid``: what a rigid flat at the same displacement
        would cut off, unless the displacement is NaN; it ranks by height too. ``curvature``: the
        points of the most convex surface, as many as are in contact, ranked by mean curvature.
        Rigid interpenetration at the area of the contact *is* the highest points, so it does not
        stand here again.
    """
    contact = pressure > 0
    count = int((contact & valid).sum())
    curvature = mean_curvature(heights, spacing, curvature_length)
    found = {
        "contact": (contact, contact_ranking(pressure, gap)),
        "highest": (highest_points(heights, count, valid), heights),
        "rigid": (rigid_interpenetration(heights, displacement), None),
        "curvature": (highest_points(curvature, count, valid), curvature),
    }
    if math.isnan(displacement):
        del found["rigid"]
    return {
        name: Prediction(mask, fractions(mask, window), ranking)
        for name, (mask, ranking) in found.items()
    }


def contact_ranking(pressure: np.ndarray, gap: np.ndarray | None = None) -> np.ndarray:
    """How likely each point is to wear by the contact solution, as a score to rank by.

    The pressure (MPa) where there is contact, minus the gap (mm) where there is none, so that a
    point nearly touched ranks above one far from it; only the order means something. Without a
    gap all points out of contact are equal.
    """
    pressure = np.asarray(pressure, dtype=float)
    outside = 0.0 if gap is None else -np.maximum(np.asarray(gap, dtype=float), 0)
    return np.where(pressure > 0, pressure, outside)


def highest_points(values: np.ndarray, count: int, valid: np.ndarray | None = None) -> np.ndarray:
    """Mask of the `count` valid points of the highest values: of heights, or of another guess.

    Among equal values the first in row order win, so the count is exact.
    """
    values = np.asarray(values, dtype=float)
    valid = np.ones(values.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    known = values[valid]
    if not 0 <= count <= known.size:
        raise ValueError(f"{count} highest points asked of {known.size} valid ones")
    if not count:
        return np.zeros(values.shape, dtype=bool)
    last = np.partition(known, known.size - count)[known.size - count]
    mask = valid & (values > last)
    ties = np.flatnonzero(valid & (values == last))
    mask.ravel()[ties[: count - mask.sum()]] = True
    return mask


def rigid_interpenetration(heights: np.ndarray, displacement: float) -> np.ndarray:
    """Mask of the points that a rigid flat reaches, `displacement` (mm) below the highest one."""
    heights = np.asarray(heights, dtype=float)
    return heights > heights.max() - displacement


def mean_curvature(heights: np.ndarray, spacing: Sequence[float], length: float) -> np.ndarray:
    """Mean curvature of the smoothed surface, 1/mm, positive on summits.

    Parameters
    ----------
    heights : (ny, nx) array_like
        mm.
    spacing : (dy, dx)
        mm.
    length : float
        Standard deviation of the Gaussian smoothing, mm.
    """
    sigma = [length / step for step in spacing]
    # smoothed, then differenced: kernels of a derivative of a Gaussian, cut off, see the level
    smooth = scipy.ndimage.gaussian_filter(np.asarray(heights, dtype=float), sigma, mode="nearest")
    slope_y, slope_x = np.gradient(smooth, *spacing)
    bend_yy, bend_yx = np.gradient(slope_y, *spacing)
    bend_xx = np.gradient(slope_x, spacing[1], axis=1)
    square_y, square_x = 1 + slope_y**2, 1 + slope_x**2
    bend = square_y * bend_xx - 2 * slope_x * slope_y * bend_yx + square_x * bend_yy
    return -bend / (2 * (square_x + square_y - 1) ** 1.5)
