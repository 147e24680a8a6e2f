"""Outliers of a scan: the paper's rule, and a robust one.

Both look at the (2r + 1)² points of a square window, ±r points around each point.

``window`` is the paper's rule (Marulli, Sorrentino & Paggi 2024, section 2.2). A point is an
outlier if |z - Z_ave| > kσ. Z_ave and σ are the mean and the r.m.s. deviation of its window. k is
set so that at most a given share of the points is replaced. The rule therefore replaces that share
of every scan, with or without spikes. The point is in its own window, so |z - Z_ave|/σ cannot
exceed √(n - 1) for n points in the window. The limit for a cluster of m equal spikes is √((n -
m)/m). A window therefore finds clusters of up to about an eighth of its points (ratio 2.6), which
bounds r from below.

``median`` is the Hampel identifier (Davies & Gather 1993). A point is an outlier if |z - M| > tS. M
is the median of the window, and S = 1.4826 median |z - M| over the window. S is the standard
deviation of normal noise, and spikes do not raise it. t is fixed, so a scan without spikes loses
almost no points. Clusters of up to nearly half of the window's points are found.
"""

import numpy as np
import scipy
import xarray as xr
from numpy.lib.stride_tricks import sliding_window_view

from gstlib.surfaces.fitting import MAD_TO_SIGMA
from gstlib.surfaces.leveling import remove_plane

__all__ = ["height_step", "median_outliers", "window_outliers"]

# An r.m.s. below this share of the largest height is rounding of the running sums, not roughness.
_ROUNDING = 1e-7
# Deviations below this share of the largest measured height are rounding in double precision.
_DOUBLE_ROUNDING = 1e-12
# Heights are stored in visible steps if fewer than this share of the points differ in height.
_FEW_HEIGHTS = 0.1


def height_step(surface: xr.DataArray) -> float:
    """Step in which the heights (mm) as measured were stored; 0 if it is too small to be seen.

    >>> rough = np.random.default_rng(1).normal(0, 3e-3, (40, 40))
    >>> rounded = xr.DataArray(rough.round(3), dims=("y", "x"))
    >>> height_step(rounded), height_step(rounded.copy(data=rough))
    (0.001, 0.0)
    """
    heights = surface.values[np.isfinite(surface.values)]
    distinct = np.unique(heights)
    if not 1 < distinct.size <= _FEW_HEIGHTS * heights.size:
        return 0.0
    return float(np.median(np.diff(distinct)))


def window_outliers(
    surface: xr.DataArray, *, half_width: int, share: float, measured: np.ndarray
) -> tuple[np.ndarray, float]:
    """Outliers by the paper's rule: at most a given share of the measured points.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, without NaN.
    half_width : int
        r, points on each side of the window's centre.
    share : float
        Largest share (0 to 1) of the measured points that may count as outliers.
    measured : (ny, nx) ndarray of bool
        The points that may be outliers. Filled points cannot.

    Returns
    -------
    outlier : (ny, nx) ndarray of bool
    k : float
        The smallest threshold that keeps to `share`.
    """
    # ASSUME: Deviation from the levelled surface. In the paper's outlier rule, σ is computed from
    # the levelled surface. Reason: The tilt results from the placement of the stone. On a smooth
    # surface, σ would measure only this tilt.
    heights = remove_plane(surface)[0].values
    # The variance is a difference of sums: a large common height would swamp it.
    heights = heights - heights.mean()
    # ASSUME: Extent of the outlier window. The window includes its centre, and the map is mirrored
    # at its edges. Reason: The paper does not state this. All windows then have the same number of
    # points.
    mean, square = (
        scipy.ndimage.uniform_filter(values, 2 * half_width + 1, mode="reflect")
        for values in (heights, heights**2)
    )
    rms = np.sqrt(np.maximum(square - mean**2, 0.0))
    rough = measured & (rms > _ROUNDING * np.abs(heights).max())
    ratio = np.zeros_like(rms)
    np.divide(np.abs(heights - mean), rms, out=ratio, where=rough)
    # The paper bisects for k. The threshold to which it converges is a ratio in the map itself.
    allowed = min(int(share * np.count_nonzero(measured)), ratio.size - 1)
    place = -1 - allowed
    k = float(np.partition(ratio, place, axis=None)[place])
    return ratio > k, k


def median_outliers(
    surface: xr.DataArray, *, half_width: int, threshold: float, step: float = 0.0
) -> tuple[np.ndarray, float]:
    """Outliers by the robust rule: every point farther off than a given threshold.

    Unmeasured points are in no window. If filled, they would hide the spikes next to them.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, NaN where unmeasured.
    half_width : int
        r, points on each side of the window's centre.
    threshold : float
        t, in robust standard deviations.
    step : float
        Step of the stored heights, mm, from `height_step`.

    Returns
    -------
    outlier : (ny, nx) ndarray of bool
    scale : float
        Robust standard deviation (mm) of all points from the medians of their windows.
    """
    heights = remove_plane(surface)[0].values
    measured = np.isfinite(heights)
    # With half the unmeasured points above everything and half below, the median is the others'.
    above = np.indices(heights.shape).sum(axis=0) % 2 == 1
    entered = np.where(measured, heights, np.where(above, np.inf, -np.inf))
    off = np.abs(heights - _medians(_windows(entered, half_width)))
    # ASSUME: Lower bound of the local scale. S is at least the value of the whole map, and half of
    # the step in which heights were stored. Reason: Otherwise, the small unevenness of a much
    # smoother spot would be marked as outliers, or each height that is one step off.
    scale = max(
        MAD_TO_SIGMA * float(np.median(off[measured])),
        step / 2,
        _DOUBLE_ROUNDING * float(np.nanmax(np.abs(surface.values))),
    )
    # Because of that bound only these points can be outliers: few enough to gather their windows.
    at = np.nonzero(off > threshold * scale)
    around = _windows(heights, half_width)[at]
    median = np.nanmedian(around, axis=(1, 2))
    deviations = np.abs(around - median[:, None, None])
    local = MAD_TO_SIGMA * np.nanmedian(deviations, axis=(1, 2))
    outlier = np.zeros(heights.shape, dtype=bool)
    outlier[at] = np.abs(heights[at] - median) > threshold * np.maximum(local, scale)
    return outlier, scale


def _windows(heights: np.ndarray, half_width: int) -> np.ndarray:
    """The window around each point: a view (ny, nx, 2r + 1, 2r + 1)."""
    # The map is mirrored about its outermost points themselves: a spike there is not doubled.
    padded = np.pad(heights, half_width, mode="reflect")
    return sliding_window_view(padded, 2 * (2 * half_width + 1,))


def _medians(windows: np.ndarray) -> np.ndarray:
    """Median (ny, nx) of each window. The windows do not contain NaN.

    It takes half the time of `scipy.ndimage.median_filter`, row by row, which stay in cache.
    """
    medians = np.empty(windows.shape[:2])
    for of_row, row in zip(medians, windows, strict=True):
        points = row.reshape(len(row), -1)
        middle = points.shape[1] // 2
        of_row[:] = np.partition(points, middle)[:, middle]
    return medians
