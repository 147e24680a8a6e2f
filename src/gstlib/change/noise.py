"""The error of a height change: how it grows with slope, how far neighbours share it.

The error of a point comes from both heights and, on a slope, from its position: its variance is
fitted to the unchanged part as a + b s², where s is the slope (as Hugonnet et al. 2022, IEEE J.
Sel. Top. Appl. Earth Obs. 15:6456, do for repeat surveys); √b is the lateral distance by which the
two measurements miss each other.

Neighbouring points err alike, because instruments scan lines, filter and drift. Noise therefore
exceeds the level of detection in spots, the larger the farther errors correlate. A spot counts if
it is larger than noise makes it (the cluster extent of neuroimaging: Forman et al. 1995, Magnetic
Resonance in Medicine 33:636).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.surfaces.fitting import MAD_TO_SIGMA, least_squares, robust_sigma
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

# ASSUME: LoD95 = 1.96 standard deviations of the height difference on the unchanged part at the
# slope of the point. It includes the noise of both scans and the residue of the registration; about
# 2.5 % of unchanged points exceed it on either side.
LEVEL_OF_DETECTION = 1.96
# ASSUME: two measurements differ no finer than instruments store heights: in single precision, 1e-7
# of their variation. Smaller differences are rounding, and would give traces of a scan given twice.
RESOLUTION = 1e-7
# Points farther than this from the plane, in standard deviations, are left out of the fit.
_TRIM = 3.0
# The trimmed set settles in a few rounds, or soon alternates; this bound is only a safeguard.
_ROUNDS = 50
# The variance is fitted to this many groups of points of similar slope, this many times.
_SLOPE_GROUPS, _SLOPE_ROUNDS = 20, 3
# A group's variance is accurate to about a tenth; fewer groups than this cannot be fitted.
_GROUP_SIZE, _LEAST_GROUPS = 250, 4
# In the weights, fitted variances are at least this share of the largest one.
_SMALLEST = 1e-6
# Slopes are taken from heights smoothed over this many points: a single point's slope is noise.
_SLOPE_SMOOTHING = 1.0
# ASSUME: errors of two points are alike if they correlate by more than a half. Without a repeat,
# all that the unchanged part shows is taken for error, also wear below the level of detection.
_ALIKE = 0.5
# Farthest points whose errors are compared, as a share of the field.
_REACH = 1 / 8
# Spots count that have at least so many times the neighbours that err alike. Spots of Gaussian
# noise beyond 1.96 sigma have 0.3 times as many on average, and their sizes are exponential
# (Friston et al. 1994, Human Brain Mapping 1:210): noise then marks 1e-6 of the area. Real errors
# have longer tails, and mark more (`benchmarks/measured_surfaces.py`).
CLUSTER = 4.0
# A smaller spot counts, too, if most of its points exceed the limit so many times: smooth errors
# exceed it over large spots, and by little.
_DEEP = 3.0


class Detection(NamedTuple):
    """The error of a height change as repeated scans show it: at slope s its variance is a + b s².

    Attributes
    ----------
    level_mm2 : float
        a: the variance on level ground, mm².
    lateral_mm2 : float
        b: its growth with the squared slope, mm².
    alike_mm2 : float
        The area around a point on which errors correlate with its error by more than a half, mm².
    limit : float
        How many standard deviations one error in twenty exceeds: 1.96 if they are normal.
    """

    level_mm2: float
    lateral_mm2: float
    alike_mm2: float
    limit: float

    @classmethod
    def from_attrs(cls, attrs: Mapping) -> Self | None:
        """From the attributes of a file; None if they lack it, because no repeat served."""
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
    """The error of a change (NaN if unknown) from its unchanged part, of which `kept` marks some.

    Its variance is at least `smallest`.
    """
    inside = np.isfinite(left)
    level, lateral = variance_by_slope(left[inside], steepness[inside], kept)
    error = np.sqrt(np.maximum(level + lateral * steepness, smallest))
    alike_mm2 = _alike_points(left / error) * cell_mm2
    return Detection(level, lateral, alike_mm2, LEVEL_OF_DETECTION)


def _alike_points(error: np.ndarray) -> float:
    """Points around a point whose errors correlate with its error by more than a half.

    `error` is in standard deviations, NaN if unknown; what is beyond `_TRIM` is no error.
    """
    kept = np.abs(error) <= _TRIM
    centred = np.where(kept, error - np.mean(error[kept]), 0.0)
    reach = [max(1, int(_REACH * count)) for count in error.shape]
    size = [
        scipy.fft.next_fast_len(count + far, real=True)
        for count, far in zip(error.shape, reach, strict=True)
    ]
    products = _correlated(centred, size)
    pairs = _correlated(kept.astype(float), size)
    lags = np.ix_(*(np.arange(-far, far + 1) for far in reach))
    covariance = products[lags] / np.maximum(pairs[lags], 1.0)
    variance = covariance[*reach]
    return float(np.sum(covariance > _ALIKE * variance) - 1)


def _correlated(field: np.ndarray, size: Sequence[int]) -> np.ndarray:
    """Sums of products of a field and itself, by the lag between them."""
    spectrum = scipy.fft.rfft2(field, size)
    return scipy.fft.irfft2(np.abs(spectrum) ** 2, size)


def squared_slopes(surface: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    """Squared slopes along y and x of smoothed heights, free of single points' noise."""
    dy, dx = spacing_of(surface)
    heights = surface.values
    rise_y = scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=(1, 0))
    rise_x = scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=(0, 1))
    return (rise_y / dy) ** 2, (rise_x / dx) ** 2


def variance_by_slope(
    change: np.ndarray, steepness: np.ndarray, kept: np.ndarray
) -> tuple[float, float]:
    """Variance of the change on level ground (mm²), and its growth with the squared slope (mm²).

    The arrays (n,) are those of the known points; `kept` marks the unchanged ones, to begin with.
    """
    size = np.abs(change)
    spread = MAD_TO_SIGMA * float(np.median(size[kept]))
    level, lateral = spread**2, 0.0
    count = max(1, min(_SLOPE_GROUPS, change.size // _GROUP_SIZE))
    shares = np.linspace(0, 1, count + 1)[1:-1]
    edges = np.quantile(steepness, shares)
    group = np.searchsorted(edges, steepness)
    for _ in range(_SLOPE_ROUNDS):
        points = pd.DataFrame({"slope": steepness[kept], "change": size[kept]})
        groups = points.groupby(group[kept])
        is_large = groups.size() >= _GROUP_SIZE / 2
        typical = groups.agg({"slope": "mean", "change": "median"})[is_large]
        slopes = typical.slope.values
        sigmas = MAD_TO_SIGMA * typical.change.values
        variances = sigmas**2
        if len(typical) < _LEAST_GROUPS or not variances.any():
            break
        scale = float(slopes.max()) or 1.0
        # the error of a variance is proportional to it; the fitted variance is used, because the
        # measured one would favour groups that came out small
        smallest = _SMALLEST * variances.max()
        weight = 1 / np.maximum(level + lateral * slopes, smallest)
        design = np.stack([weight, weight * slopes / scale], axis=1)
        (level, lateral), _ = scipy.optimize.nnls(design, weight * variances)
        lateral /= scale
        # steep points may be off by more than the fit of the plane allows
        sigma = np.sqrt(level + lateral * steepness)
        kept = size <= _TRIM * sigma
    return float(level), float(lateral)


def unchanged_plane(
    design: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Plane through the unchanged points, their robust spread, and a mask of them."""
    # ASSUME: the unchanged part is the largest population of height differences: the fit starts
    # from the shortest half of them, so wear of nearly half of the area, all on one side, does not
    # pull the datum down as a least-squares plane would.
    plane = np.array([np.median(values), 0.0, 0.0])
    before = kept = np.zeros(values.size, dtype=bool)
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        ordered, half = np.sort(left), left.size // 2
        lengths = ordered[half:] - ordered[: left.size - half]
        start = int(np.argmin(lengths))
        centre = ordered[start] + lengths[start] / 2
        # half of a normal population is within 0.6745 sigma of its mean
        sigma = lengths[start] / 2 / 0.6745
        now = np.abs(left - centre) <= _TRIM * sigma
        # settled, or alternating between two sets a few points apart
        if (now == kept).all() or (now == before).all():
            break
        before, kept = kept, now
        plane = least_squares(design[:, kept], values[kept])
    # the shortest half is wide if much has worn; the kept points give the spread of the rest
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        sigma = robust_sigma(left[kept])
        now = np.abs(left) <= _TRIM * sigma
        is_settled = (now == kept).all()
        if is_settled or now.sum() < 3:
            break
        kept = now
        plane = least_squares(design[:, kept], values[kept])
    return plane, sigma, kept


def spots(
    excess: np.ndarray, minimum_cluster_points: int, cluster_points: int
) -> np.ndarray:
    """The points beyond the level of detection in spots that count; corners count as adjacent.

    `excess` is the change over the level of detection.
    """
    # ASSUME: use leaves spots of several points; smaller spots beyond the level of detection are
    # noise, though some may be true.
    spot, _ = scipy.ndimage.label(excess > 1, np.ones((3, 3)))
    size = np.bincount(spot.ravel())
    counts = size >= cluster_points
    if cluster_points > minimum_cluster_points:
        deep = np.bincount(spot[excess > _DEEP], minlength=size.size)
        counts |= (size >= minimum_cluster_points) & (deep > size / 2)
    counts[0] = False
    return counts[spot]
