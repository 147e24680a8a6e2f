"""Outliers of a scan by the paper's rule: too far from the mean of a window, in units of its rms.

A point is an outlier where |z - Z_ave| > kσ, with Z_ave and σ the mean and the r.m.s. deviation of
the heights in the square window of ±r points around it; k is found by bisection so that at most a
given share of the points is replaced (Marulli, Sorrentino & Paggi 2024, section 2.2).

With the point itself in its window, |z - Z_ave|/σ cannot exceed √(n - 1) for n points in the
window, nor √((n - m)/m) for a cluster of m equal spikes: a window finds clusters of up to about an
eighth of its points (ratio 2.6), which bounds r from below.
"""

import numpy as np
import xarray as xr
from scipy.ndimage import uniform_filter

from gstlib.preprocess.filling import interpolate_holes
from gstlib.preprocess.leveling import remove_plane

__all__ = ["deviation_ratio", "replace_outliers"]

# Relative width at which the bisection of k stops: finer than the spacing of the points' ratios.
_BISECTION_TOLERANCE = 1e-9
# Rms below this share of the largest height is rounding of the running sums, not roughness.
_ROUNDING = 1e-7


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


def replace_outliers(
    surface: xr.DataArray, *, half_width: int, share: float
) -> tuple[xr.DataArray, xr.DataArray, float]:
    """Replace the outliers, at most a given share of the points.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, without NaN.
    half_width : int
        r, points on each side of the window's centre.
    share : float
        Largest share (0 to 1) of the points that may be replaced.

    Returns
    -------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, with the outliers replaced.
    outlier : (ny, nx) xarray.DataArray of bool
        What was replaced.
    k : float
        Threshold found: the smallest (to the bisection's tolerance) that keeps to `share`.
    """
    # ASSUME: σ is that of the level surface. The tilt is the placement's, not the stone's, and on a
    # smooth surface it would be all that σ sees.
    level, _ = remove_plane(surface)
    ratio = deviation_ratio(level.values, half_width)
    k = _bisect_threshold(ratio, share)
    outlier = ratio > k
    # ASSUME: an outlier gets the value interpolated linearly from the points around it that are
    # none; a mean over the window would stand off its neighbours on any slope.
    heights = interpolate_holes(surface.values, outlier)
    mask = xr.DataArray(outlier, coords=surface.coords, dims=surface.dims, name="outlier")
    return surface.copy(data=heights), mask, k


def _bisect_threshold(ratio: np.ndarray, share: float) -> float:
    """Smallest k with at most `share` of the ratios above it."""
    allowed = share * ratio.size
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
