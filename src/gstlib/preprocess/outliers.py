"""Outliers of a scan, by the paper's rule and by a robust one. Each looks at the (2r + 1)² points
of the square window of ±r points around a point.

``window``, the paper's (Marulli, Sorrentino & Paggi 2024, section 2.2): a point is an outlier where
|z - Z_ave| > kσ, with Z_ave and σ the mean and the r.m.s. deviation of the window; k is found by
bisection so that at most a given share of the points is replaced. It thus takes that share of every
scan, spikes or none. With the point itself in its window, |z - Z_ave|/σ cannot exceed √(n - 1) for
n points in the window, nor √((n - m)/m) for a cluster of m equal spikes: a window finds clusters of
up to about an eighth of its points (ratio 2.6), which bounds r from below.

``median``, the Hampel identifier (Davies & Gather 1993): a point is an outlier where |z - M| > tS,
with M the median of the window and S = 1.4826 median |z - M| over the window, which is the standard
deviation for normal noise and does not see the spikes. t is given, so that a scan without spikes
loses next to nothing. Clusters are found up to nearly half the window's points.
"""

import numpy as np
import xarray as xr
from scipy.ndimage import median_filter, uniform_filter

from gstlib.preprocess.leveling import remove_plane

__all__ = ["RULES", "deviation_ratio", "median_outliers", "window_outliers"]

RULES = ("window", "median")

# Relative width at which the bisection of k stops: finer than the spacing of the points' ratios.
_BISECTION_TOLERANCE = 1e-9
# Rms below this share of the largest height is rounding of the running sums, not roughness.
_ROUNDING = 1e-7
# Deviations below this share of the largest height as measured are rounding of double precision.
_DOUBLE_ROUNDING = 1e-12
# Standard deviation of normal noise over its median absolute deviation.
_NORMAL = 1.4826
# Heights looked at in one go: bounds the memory where half of a scan is suspect.
_CHUNK = 4_000_000


def window_outliers(
    surface: xr.DataArray,
    *,
    half_width: int,
    share: float,
    measured: np.ndarray | None = None,
) -> tuple[np.ndarray, float]:
    """Outliers by the paper's rule: at most a given share of the points.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, without NaN.
    half_width : int
        r, points on each side of the window's centre.
    share : float
        Largest share (0 to 1) of the measured points that may be called outliers.
    measured : (ny, nx) ndarray of bool, optional
        Points that may be outliers: what was filled is none. All by default.

    Returns
    -------
    outlier : (ny, nx) ndarray of bool
    k : float
        Threshold found: the smallest (to the bisection's tolerance) that keeps to `share`.
    """
    # ASSUME: σ is that of the level surface. The tilt is the placement's, not the stone's, and on a
    # smooth surface it would be all that σ sees.
    level, _ = remove_plane(surface)
    ratio = deviation_ratio(level.values, half_width)
    if measured is not None:
        ratio = np.where(measured, ratio, 0.0)
    count = ratio.size if measured is None else np.count_nonzero(measured)
    k = _bisect_threshold(ratio, share * count)
    return ratio > k, k


def deviation_ratio(heights: np.ndarray, half_width: int) -> np.ndarray:
    """|z - Z_ave|/σ of each point in its window of ±`half_width` points.

    Parameters
    ----------
    heights : (ny, nx) ndarray
        mm, without NaN.
    half_width : int
        r; the window has (2r + 1)² points.

    Returns
    -------
    (ny, nx) ndarray
        0 where the window is flat.
    """
    window = 2 * half_width + 1
    # The mean is taken out first: the variance is a difference of sums, which large common
    # heights would drown.
    heights = heights - heights.mean()
    # ASSUME: the window includes its centre, and is mirrored at the edges of the map.
    mean = uniform_filter(heights, window, mode="reflect")
    square = uniform_filter(heights**2, window, mode="reflect")
    rms = np.sqrt(np.maximum(square - mean**2, 0.0))
    rough = rms > _ROUNDING * np.abs(heights).max()
    return np.where(rough, np.abs(heights - mean) / np.where(rough, rms, 1.0), 0.0)


def _bisect_threshold(ratio: np.ndarray, allowed: float) -> float:
    """Smallest k with at most `allowed` of the ratios above it."""
    low, high = 0.0, float(ratio.max())  # none are above the largest
    if np.count_nonzero(ratio > low) <= allowed:
        return low
    while high - low > _BISECTION_TOLERANCE * high:
        middle = (low + high) / 2
        if np.count_nonzero(ratio > middle) > allowed:
            low = middle
        else:
            high = middle
    return high


def median_outliers(
    surface: xr.DataArray, *, half_width: int, threshold: float
) -> tuple[np.ndarray, float]:
    """Outliers by the robust rule: however many stand further off than a given threshold.

    Unmeasured points are in no window: filled, they would hide the spikes that they were filled
    from.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, NaN where unmeasured.
    half_width : int
        r, points on each side of the window's centre.
    threshold : float
        t, in robust standard deviations.

    Returns
    -------
    outlier : (ny, nx) ndarray of bool
    scale : float
        Robust standard deviation (mm) of all points from the medians of their windows.
    """
    heights = remove_plane(surface)[0].values
    window = 2 * half_width + 1
    measured = np.isfinite(heights)
    # As many unmeasured points above everything as below it leave the others' median.
    above = np.indices(heights.shape).sum(axis=0) % 2 == 1
    entered = np.where(measured, heights, np.where(above, np.inf, -np.inf))
    # Mirrored about the points of the rim themselves, not to double a spike that lies on it.
    off = np.abs(heights - median_filter(entered, window, mode="mirror"))
    # ASSUME: S is no less than that of the whole map. Where a spot is much smoother than the rest,
    # its small unevenness would be outliers.
    scale = max(
        _NORMAL * float(np.median(off[measured])),
        _DOUBLE_ROUNDING * float(np.nanmax(np.abs(surface.values))),
    )
    # With that bound, only these can be outliers: few enough to look at their windows one by one.
    rows, columns = np.nonzero(off > threshold * scale)
    padded = np.pad(heights, half_width, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (window, window))
    outlier = np.zeros(heights.shape, dtype=bool)
    step = max(1, _CHUNK // window**2)
    for first in range(0, len(rows), step):
        at = rows[first : first + step], columns[first : first + step]
        around = windows[at].reshape(-1, window**2)
        median = _median(around)
        local = _NORMAL * _median(np.abs(around - median[:, None]))
        distance = np.abs(heights[at] - median)
        outlier[at] = distance > threshold * np.maximum(local, scale)
    return outlier, scale


def _median(values: np.ndarray) -> np.ndarray:
    """Median of each row without its NaN, of which `np.nanmedian` makes slow work."""
    ordered = np.sort(values, axis=1)  # NaN last
    count = np.count_nonzero(np.isfinite(values), axis=1)
    row = np.arange(len(values))
    return (ordered[row, (count - 1) // 2] + ordered[row, count // 2]) / 2
