"""The error of a height change: its growth with slope, and its correlation between neighbours.

The error of a point comes from both heights and, on a slope, from its position. Its variance is
fitted to the unchanged part as a + b s², where s is the slope (as Hugonnet et al. 2022, IEEE J.
Sel. Top. Appl. Earth Obs. 15:6456, do for repeat surveys). √b is the lateral misfit of the two
measurements.

Errors of neighbouring points are alike, because instruments scan lines, filter and drift. Noise
therefore exceeds the level of detection in spots, which grow with the range of correlation. A spot
counts if it is larger than spots of noise (the cluster extent of neuroimaging: Forman et al. 1995,
Magnetic Resonance in Medicine 33:636).
"""

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.surfaces.filtering import smooth_rises
from gstlib.surfaces.fitting import (
    MAD_TO_SIGMA,
    least_squares,
    planes_over,
    robust_sigma,
)
from gstlib.surfaces.grid import spacing_of

__all__ = [
    "CLUSTER",
    "LEVEL_OF_DETECTION",
    "RESOLUTION",
    "Detection",
    "own_detection",
    "spots",
    "squared_slopes",
    "unchanged_plane",
    "variance_by_slope",
]

# ASSUME: Level of detection. LoD95 is 1.96 standard deviations of the height difference on the
# unchanged part at the slope of the point. About 2.5 % of unchanged points exceed it on either
# side. Reason: It includes the noise of both scans and the residue of the registration.
LEVEL_OF_DETECTION = 1.96
# ASSUME: Resolution of stored heights. Differences below single precision, 1e-7 of the variation of
# heights, are rounding. If heights are stored in larger steps, both epochs are off by up to half a
# step. Reason: Smaller differences would give traces of a scan that is given twice, and equal
# heights in many points would hide the rounding.
RESOLUTION = 1e-7
# Points farther from the plane than this number of standard deviations are left out of the fit.
_TRIM = 3.0
# The trimmed set settles in a few rounds, or soon alternates; this bound is only a safeguard.
_ROUNDS = 50
# The variance is fitted to this many groups of points of similar slope, this many times.
_SLOPE_GROUPS, _SLOPE_ROUNDS = 20, 3
# The variance of a group is accurate to about a tenth. Fewer groups than this cannot be fitted.
_GROUP_SIZE, _LEAST_GROUPS = 250, 4
# In the weights, fitted variances are at least this fraction of the largest one.
_SMALLEST = 1e-6
# Slopes are taken from heights smoothed over this many points, because the slope at one point is
# noise.
_SLOPE_SMOOTHING = 1.0
# ASSUME: Extent of correlated errors. Errors of two points are alike if they correlate by more than
# a half. Without a repeat, all differences of the unchanged part count as error, including wear
# below the level of detection. Reason: Without a repeat, two scans do not separate error from such
# wear.
_ALIKE = 0.5
# Largest distance of compared errors, as a fraction of the field. Errors of whole scan lines then
# count as alike over half of the field, so that no single line is a trace.
_REACH = 1 / 4
# Spots count if they have at least this many times the number of neighbours with like errors. Spots
# of Gaussian noise beyond 1.96 sigma have 0.3 times as many on average, and their sizes are
# exponential (Friston et al. 1994, Human Brain Mapping 1:210). Noise then marks 1e-6 of the area.
# Real errors have longer tails, and mark more (`benchmarks/measured_surfaces.py`).
CLUSTER = 4.0
# A smaller spot also counts if most of its points exceed the limit this many times. Smooth errors
# exceed it over large spots, but only slightly.
_DEEP = 3.0


class Detection(NamedTuple):
    """The error of a height change from repeated scans, with variance a + b s² at slope s.

    Attributes
    ----------
    level_mm2 : float
        a: the variance on level ground, mm².
    lateral_mm2 : float
        b: its growth with the squared slope, mm².
    alike_mm2 : float
        The area around a point on which errors correlate with its error by more than a half, mm².
    limit : float
        The number of standard deviations that one error in twenty exceeds, 1.96 for normal errors.
    """

    level_mm2: float
    lateral_mm2: float
    alike_mm2: float
    limit: float

    @classmethod
    def from_attrs(cls, attrs: Mapping) -> Self | None:
        """From the attributes of a file; None if they are missing, because no repeat was valid."""
        if not attrs.keys() >= set(cls._fields):
            return None
        return cls(*(float(attrs[name]) for name in cls._fields))


def own_detection(
    left: np.ndarray,
    steepness: np.ndarray,
    kept: np.ndarray,
    smallest: float,
    cell_mm2: float,
) -> Detection:
    """The error of a change (NaN if unknown) from its unchanged part, marked by `kept` in part.

    Its variance is at least `smallest`.
    """
    inside = np.isfinite(left)
    level, lateral = variance_by_slope(left[inside], steepness[inside], kept)
    error = np.sqrt(np.maximum(level + lateral * steepness, smallest))
    alike_mm2 = _alike_points(left / error) * cell_mm2
    return Detection(level, lateral, alike_mm2, LEVEL_OF_DETECTION)


def _alike_points(error: np.ndarray) -> float:
    """Number of points around a point whose errors correlate with its error by more than a half.

    `error` is in standard deviations, NaN if unknown. Values beyond `_TRIM` are not errors.
    """
    kept = np.abs(error) <= _TRIM
    centred = np.where(kept, error - np.mean(error[kept]), 0.0)
    reach = [max(1, int(_REACH * count)) for count in error.shape]
    size = [
        scipy.fft.next_fast_len(count + far, real=True)
        for count, far in zip(error.shape, reach, strict=True)
    ]
    spectra = scipy.fft.rfft2([centred, kept], size)
    products, pairs = scipy.fft.irfft2(np.abs(spectra) ** 2, size)
    lags = np.ix_(*(np.arange(-far, far + 1) for far in reach))
    covariance = products[lags] / np.maximum(pairs[lags], 1.0)
    variance = covariance[*reach]
    return float(np.sum(covariance > _ALIKE * variance) - 1)


def squared_slopes(surface: xr.DataArray) -> np.ndarray:
    """Squared slopes (2, ny, nx) along y and x of smoothed heights, free of noise at points."""
    steps = np.reshape(spacing_of(surface), (2, 1, 1))
    return (smooth_rises(surface.values, _SLOPE_SMOOTHING) / steps) ** 2


def variance_by_slope(
    change: np.ndarray, steepness: np.ndarray, kept: np.ndarray
) -> tuple[float, float]:
    """Variance of the change on level ground (mm²), and its growth with the squared slope (mm²).

    The arrays (n,) contain the known points; `kept` marks the initial unchanged ones.
    """
    size = np.abs(change)
    level, lateral = (MAD_TO_SIGMA * np.median(size[kept])) ** 2, 0.0
    count = max(1, min(_SLOPE_GROUPS, change.size // _GROUP_SIZE))
    shares = np.linspace(0, 1, count + 1)[1:-1]
    edges = np.quantile(steepness, shares)
    group = np.searchsorted(edges, steepness)
    for _ in range(_SLOPE_ROUNDS):
        points = pd.DataFrame({"slope": steepness, "change": size})[kept]
        groups = points.groupby(group[kept])
        typical = groups.agg({"slope": "mean", "change": "median"})
        typical = typical[groups.size() >= _GROUP_SIZE / 2]
        slopes = typical.slope.values
        variances = (MAD_TO_SIGMA * typical.change.values) ** 2
        if len(typical) < _LEAST_GROUPS or not variances.any():
            break
        scale = float(slopes.max()) or 1.0
        # The error of a variance is proportional to it. The fitted variance is used, because the
        # measured variance would favour groups with small values.
        smallest = _SMALLEST * variances.max()
        weight = 1 / np.maximum(level + lateral * slopes, smallest)
        design = np.stack([weight, weight * slopes / scale], axis=1)
        (level, lateral), _ = scipy.optimize.nnls(design, weight * variances)
        lateral /= scale
        # Steep points may differ by more than the fit of the plane allows.
        kept = size <= _TRIM * np.sqrt(level + lateral * steepness)
    return float(level), float(lateral)


def unchanged_plane(
    change: np.ndarray, inside: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Plane (ny, nx) through the unchanged points of a map, and their robust spread.

    Also returns which of the points `inside` (ny, nx) they are, (n,).
    """
    # ASSUME: Unchanged part. The unchanged part is the largest population of height differences,
    # and the fit starts from the shortest half of them. Reason: Wear of nearly half of the area,
    # all on one side, then does not lower the datum. Alternative: A least-squares plane would be
    # lowered by such wear.
    y, x = (np.linspace(-0.5, 0.5, count, endpoint=False) for count in change.shape)
    planes = planes_over(y[:, None], x)
    design, values = planes[:, inside], change[inside]
    plane = np.array([np.median(values), 0.0, 0.0])
    before = kept = np.zeros(values.size, dtype=bool)
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        ordered, half = np.sort(left), left.size // 2
        lengths = ordered[half:] - ordered[: left.size - half]
        start = np.argmin(lengths)
        centre = ordered[start] + lengths[start] / 2
        # Half of a normal population is within 0.6745 sigma of its mean.
        sigma = lengths[start] / 2 / 0.6745
        now = np.abs(left - centre) <= _TRIM * sigma
        # The set has settled, or alternates between two sets a few points apart.
        if (now == kept).all() or (now == before).all():
            break
        before, kept = kept, now
        plane = least_squares(design[:, kept], values[kept])
    # The shortest half is wide if much has worn; the kept points give the spread of the rest.
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        sigma = robust_sigma(left[kept])
        now = np.abs(left) <= _TRIM * sigma
        if (now == kept).all() or now.sum() < 3:
            break
        kept = now
        plane = least_squares(design[:, kept], values[kept])
    return np.einsum("i,ijk->jk", plane, planes), sigma, kept


def spots(
    excess: np.ndarray, minimum_cluster_points: int, cluster_points: int
) -> np.ndarray:
    """Points beyond the level of detection in spots that count; corners count as adjacent.

    `excess` is the change over the level of detection.
    """
    # ASSUME: Smallest trace. Traces of use are spots of several points, and smaller spots beyond
    # the level of detection are noise, although some may be real. Reason: Noise at single points
    # often exceeds the level of detection.
    spot, _ = scipy.ndimage.label(excess > 1, np.ones((3, 3)))
    size = np.bincount(spot.ravel())
    counts = size >= cluster_points
    if cluster_points > minimum_cluster_points:
        deep = np.bincount(spot[excess > _DEEP], minlength=size.size)
        counts |= (size >= minimum_cluster_points) & (deep > size / 2)
    counts[0] = False
    return counts[spot]
