"""What did use remove? The height change between two aligned measurements of one patch.

Every measurement has its own zero and its own tilt, so a change is only defined relative to what
did not change: the plane of the difference is fitted to the largest population of points that agree
with each other. A change counts where it exceeds the level of detection, as in the comparison of
repeat surveys (Brasington et al. 2003, Geomorphology 53:299; Wheaton et al. 2010, Earth Surf.
Process. Landf. 35:136), and where enough adjacent points do.

The error of a point comes from both heights and, on a slope, from its position: its variance is
fitted to the unchanged part as a + b s², where s is the slope (as Hugonnet et al. 2022, IEEE J.
Sel. Top. Appl. Earth Obs. 15:6456, do for repeat surveys); √b is the lateral distance by which the
two measurements miss each other. Points whose height was not measured at both epochs (filled holes,
outliers) are unknown: no change is stated there.

Neighbouring points err alike, because instruments scan lines, filter and drift. Noise therefore
exceeds the level of detection in spots, the larger the farther errors correlate. A spot counts if
it is larger than noise makes it (the cluster extent of neuroimaging: Forman et al. 1995, Magnetic
Resonance in Medicine 33:636).

A patch that was scanned twice without use between shows the same error with no wear in it. If there
are such repeats, they give a, b and the extent of correlation for all patches, and no patch scores
its own.
"""

import logging
import math
from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.change.registration import (
    LEAST_POINTS,
    Registration,
    apply_registration,
    is_other,
    register,
)
from gstlib.errors import InputError
from gstlib.surfaces.fitting import MAD_TO_SIGMA, least_squares, robust_sigma
from gstlib.surfaces.grid import described, spacing_of

__all__ = [
    "SCAN_FIELDS",
    "Detection",
    "height_change",
    "measure_detection",
    "measured_change",
    "register_patch",
    "wear_summary",
]

_log = logging.getLogger(__name__)

# What registration and change need of a prepared scan.
SCAN_FIELDS = ["height", "filled", "outlier"]

# ASSUME: LoD95 = 1.96 standard deviations of the height difference on the unchanged part at the
# slope of the point. It includes the noise of both scans and the residue of the registration; about
# 2.5 % of unchanged points exceed it on either side.
_LEVEL_OF_DETECTION = 1.96
# ASSUME: two measurements differ no finer than instruments store heights: in single precision, 1e-7
# of their variation. Smaller differences are rounding, and would give traces of a scan given twice.
_RESOLUTION = 1e-7
_TINY = np.finfo(float).tiny
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
# How much deeper, or shallower, the dales of T1 may be than those of T0 before a warning. Wear of a
# quarter of a patch makes them a tenth shallower (synthetic specimen).
_ODD_HEIGHTS = 1.25
# ASSUME: a repeat shows an unworn surface unless the shares of its area that lost and that gained
# height differ by more than 0.5 % and by more than the smaller of the two. Noise marks as much up
# as down.
_CHANGED = 0.005
# ASSUME: errors of two points are alike if they correlate by more than a half. Without a repeat,
# all that the unchanged part shows is taken for error, also wear below the level of detection.
_ALIKE = 0.5
# Farthest points whose errors are compared, as a share of the field.
_REACH = 1 / 8
# Spots count that have at least so many times the neighbours that err alike. Spots of Gaussian
# noise beyond 1.96 sigma have 0.3 times as many on average, and their sizes are exponential
# (Friston et al. 1994, Human Brain Mapping 1:210): noise then marks 1e-6 of the area. Real errors
# have longer tails, and mark more (`benchmarks/measured_surfaces.py`).
_CLUSTER = 4.0
# A smaller spot counts, too, if most of its points exceed the limit so many times: smooth errors
# exceed it over large spots, and by little.
_DEEP = 3.0
# Other software lays T1 on T0 to whole points: a smaller shift is one of none.
_CO_LOCATED = 0.5
# Units and meanings of the maps of a change.
_FIELDS = {
    "t1": ("mm", "height at T1 on the grid of T0"),
    "change": ("mm", "height change from T0 to T1"),
    "level_of_detection": ("mm", "height change that noise exceeds on one point in twenty"),
    "loss": ("1", "height loss beyond the level of detection"),
    "gain": ("1", "height gain beyond the level of detection"),
}
# How much more the unchanged part of a patch may scatter than repeats do before a warning.
_ODD_SCATTER = 2.0


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
    def of(cls, attrs: Mapping) -> Self | None:
        """From the attributes of a file; None if they lack it, because no repeat served."""
        if not attrs.keys() >= set(cls._fields):
            return None
        return cls(*(float(attrs[name]) for name in cls._fields))


def measure_detection(
    before: Mapping[str, xr.Dataset],
    again: Mapping[str, xr.Dataset],
    *,
    maximum_shift_mm: float,
    minimum_points: int,
) -> Detection | None:
    """The error of a height change, from patches that were scanned twice without use between.

    Each second scan is registered to the first as T1 is to T0. All that then differs is error; its
    variance is fitted to the points of all patches together.

    Parameters
    ----------
    before, again : mapping of str to xarray.Dataset
        The two prepared scans by patch, as in `measured_change`; each is looked up once. The
        patches are those of `again`.
    maximum_shift_mm, minimum_points
        As in `measured_change`.

    Returns
    -------
    Detection or None
        None if no pair serves. A pair that does not is left out, with a warning: where the second
        scan is not found on the first, or where the surface changed between them.
    """
    changes, slopes, alike = [], [], []
    for patch in again:
        first, second = before[patch], again[patch]
        try:
            registration, change = measured_change(
                first, second, maximum_shift_mm=maximum_shift_mm, minimum_points=minimum_points
            )
            fault = _no_repeat(registration, change)
        except InputError as error:
            fault = error.problem
        if fault is not None:
            _log.warning(
                "patch %s: its repeat is not used: %s. Give a second scan of the surface that t0 "
                "shows, or leave repeat empty in the patch table.",
                patch,
                fault,
            )
            continue
        known = np.isfinite(change["change"].values)
        changes.append(change["change"].values[known])
        slopes.append(np.sum(_squared_slopes(first.height), axis=0)[known])
        alike.append(change.attrs["alike_um2"] * 1e-6)
    if not changes:
        return None
    pooled, steepness = np.concatenate(changes), np.concatenate(slopes)
    # ASSUME: a repeat errs as T1 does: taken off, put back, and scanned with the same settings. All
    # of it is unchanged; points off by more than three standard deviations are outliers.
    level, lateral = _variance_by_slope(pooled, steepness, np.ones(pooled.size, dtype=bool))
    # the errors of instruments have longer tails than normal ones
    squares = pooled**2 / np.maximum(level + lateral * steepness, _TINY)
    limit = max(_LEVEL_OF_DETECTION, math.sqrt(np.quantile(squares, 0.95)))
    detection = Detection(level, lateral, float(max(alike)), limit)
    _log.info(
        "%d repeats: standard deviation %.3g µm on level ground, lateral error %.3g µm; errors are "
        "alike over %.3g µm²",
        len(changes),
        math.sqrt(detection.level_mm2) * 1e3,
        math.sqrt(detection.lateral_mm2) * 1e3,
        detection.alike_mm2 * 1e6,
    )
    return detection


def _no_repeat(registration: Registration, change: xr.Dataset) -> str | None:
    """Why a second scan does not show the error of the first, if it does not."""
    if not registration.found:
        return "it was not found on t0"
    if not change.attrs["known_fraction"]:
        return "hardly any point has a height of its own in both scans"
    if is_other(registration.height_scale, _ODD_HEIGHTS):
        return f"its dales are {registration.height_scale:.3g} times as deep as those of t0"
    summary = wear_summary(change)
    lost, gained = summary["loss_fraction"], summary["gain_fraction"]
    if abs(lost - gained) > max(_CHANGED, min(lost, gained)):
        return (
            f"{100 * lost:.2g} % of it lost height and {100 * gained:.2g} % gained, so the surface "
            "was not the same"
        )
    return None


def measured_change(
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    maximum_shift_mm: float,
    minimum_points: int,
    detection: Detection | None = None,
) -> tuple[Registration, xr.Dataset]:
    """Register T1 to T0 and take the height change.

    `before` and `after` are prepared scans (`gstlib.preprocess.scans.prepare_scan`): ``height``,
    ``filled``, ``outlier``. Other parameters as in `register` and `height_change`, whose results
    are returned. All change is unknown if T1 was not found.
    """
    registration = register(before.height, after.height, maximum_shift_mm=maximum_shift_mm)
    replaced0, replaced1 = (
        (epoch.filled.astype(bool) | epoch.outlier.astype(bool)).values
        for epoch in (before, after)
    )
    t0, t1 = before.height, after.height
    on_t0, replaced = apply_registration(t1, replaced1, registration, like=t0)
    known = ~(replaced0 | replaced) & registration.found
    errors_mm = registration.shift_y_error_mm, registration.shift_x_error_mm
    change = height_change(
        t0,
        on_t0,
        known,
        minimum_points=minimum_points,
        detection=detection,
        shift_errors_mm=tuple(np.nan_to_num(errors_mm)),
    )
    return registration, change


def register_patch(
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    patch: str,
    maximum_shift_mm: float,
    minimum_points: int,
    detection: Detection | None = None,
) -> xr.Dataset:
    """Register T1 to T0 and take the height change.

    `before` and `after` are prepared scans with ``height``, ``filled`` and ``outlier``. The result
    is that of `gstlib.change.change.height_change`. Its attributes have the registration, too, and
    the place of T1 on T0: ``t1_x_um, t1_y_um``, its centre from that of T0, and ``t1_size_x_um,
    t1_size_y_um``.
    """
    try:
        registration, change = measured_change(
            before,
            after,
            maximum_shift_mm=maximum_shift_mm,
            minimum_points=minimum_points,
            detection=detection,
        )
    except InputError as error:  # it names the epoch, but not the patch
        raise error.about(f"patch {patch}, {error.source}", error.problem) from error
    if registration.found:
        _report(patch, registration, before, after, change)
    if detection is not None and change.attrs["known_fraction"]:
        _warn_of_scatter(patch, change, detection)
    place = _place_of_t1(registration, before.height, after.height)
    return change.assign_attrs(registration.as_attrs() | place)


def _place_of_t1(
    registration: Registration, t0: xr.DataArray, t1: xr.DataArray
) -> dict[str, float]:
    """The centre of T1 from that of T0, and the size of T1, µm: T1 need not be as large as T0."""
    shifts = {"y": registration.shift_y_mm, "x": registration.shift_x_mm}
    place = {}
    for (axis, shift_mm), spacing in zip(shifts.items(), spacing_of(t1), strict=True):
        centre_mm = float(t1[axis].mean() - t0[axis].mean()) + shift_mm
        place[f"t1_{axis}_um"] = 1e3 * centre_mm
        place[f"t1_size_{axis}_um"] = 1e3 * spacing * t1.sizes[axis]
    return place


def _report(
    patch: str,
    registration: Registration,
    before: xr.Dataset,
    after: xr.Dataset,
    change: xr.Dataset,
) -> None:
    """Log what is odd about a patch whose T1 was found on its T0."""
    if is_other(registration.height_scale, _ODD_HEIGHTS):
        _log.warning(
            "patch %s: its dales at T1 are %.3g times as deep as at T0. If that is not wear all "
            "over the patch, the heights of one scan are calibrated otherwise: measured wear is "
            "then wrong",
            patch,
            registration.height_scale,
        )
    shift = registration.shift_y_mm, registration.shift_x_mm
    off = np.abs(np.divide(shift, spacing_of(before.height))).max()
    if off < _CO_LOCATED:
        _log.info("patch %s: T1 was co-located with T0 already: off by %.2g points", patch, off)
    if not change.attrs["known_fraction"]:
        _log.warning(
            "patch %s: hardly any point has a height of its own at T0 and at T1 (%.0f %% and "
            "%.0f %% of the scans are holes or outliers, T1 covers %.0f %% of T0), so its wear is "
            "not known. Scan it again, or leave its t1 empty.",
            patch,
            100 * (before.filled | before.outlier).values.mean(),
            100 * (after.filled | after.outlier).values.mean(),
            100 * registration.overlap,
        )


def _warn_of_scatter(patch: str, change: xr.Dataset, detection: Detection) -> None:
    """Warn where T1 scatters more about T0 than repeated scans do."""
    expected = change.attrs["level_of_detection_um"] / detection.limit
    scatter = change.attrs["change_sigma_um"] / expected
    if scatter > _ODD_SCATTER:
        _log.warning(
            "patch %s: its least changed part differs between T0 and T1 by %.3g times the "
            "error of repeated scans. If that is not wear all over the patch, T1 was scanned "
            "otherwise than the repeats, and much of its loss and gain is error",
            patch,
            scatter,
        )


def height_change(
    t0: xr.DataArray,
    t1_on_t0: xr.DataArray,
    known: np.ndarray | None = None,
    *,
    minimum_points: int = 1,
    detection: Detection | None = None,
    shift_errors_mm: tuple[float, float] = (0.0, 0.0),
) -> xr.Dataset:
    """Height change from T0 to T1, levelled on the unchanged part.

    Parameters
    ----------
    t0, t1_on_t0 : (y, x) xarray.DataArray
        Heights before and after use on one grid, mm; after use NaN outside the overlap.
    known : (y, x) ndarray of bool, optional
        Where both heights were measured; everywhere by default.
    minimum_points : int
        Fewest adjacent points (corners count) that make a loss or a gain. If the errors of
        neighbouring points correlate, more are needed, or deeper ones.
    detection : Detection, optional
        The error of a change as measured on repeated scans, from `measure_detection`; by default it
        is fitted to the unchanged part.
    shift_errors_mm : (float, float)
        Standard errors (y, x) of the registration, mm, which add to the error of repeated scans.

    Returns
    -------
    xarray.Dataset
        ``t1``: heights after use (mm), shifted and tilted to agree with T0 where nothing changed,
        NaN outside the overlap; ``change``: T1 - T0 (mm), negative where material was lost, NaN
        where it is unknown; ``level_of_detection`` (mm), NaN there, too; ``loss``, ``gain``: where
        the change exceeds the level of detection, down or up, in spots of at least
        `minimum_points`. ``level_of_detection`` is in single precision.
        Attributes: ``level_of_detection_um`` (median over the points),
        ``change_sigma_um`` (robust standard deviation of the unchanged part), ``lateral_sigma_um``
        (lateral distance by which the measurements miss each other), ``known_fraction`` (of T0's
        area), ``detection`` (where the level of detection comes from: ``repeat``, ``own``, or
        empty), ``alike_um2`` (area around a point on which errors are alike), ``cluster_points``
        (fewest adjacent points that make a loss or a gain). With fewer than 100 known points, all
        heights are NaN and nothing is known.
    """
    before, after = t0.values, t1_on_t0.values
    difference = after - before
    inside = np.isfinite(difference)
    if known is not None:
        inside &= known
    if inside.sum() < LEAST_POINTS:
        inside[:] = False
    datum, limit = np.full((2, *t0.shape), np.nan)
    sigma = lateral = typical = alike_mm2 = math.nan
    source, cluster = "", minimum_points
    if inside.any():
        places = [np.linspace(-0.5, 0.5, count, endpoint=False) for count in t0.shape]
        y, x = np.meshgrid(*places, indexing="ij")
        planes = np.stack([np.ones(t0.shape), y, x])
        plane, sigma, kept = _unchanged_plane(planes[:, inside], difference[inside])
        datum = np.einsum("i,ijk->jk", plane, planes)
        slopes = _squared_slopes(t0)
        left = np.where(inside, difference - datum, np.nan)
        smallest = float(_RESOLUTION * before[inside].std()) ** 2
        cell_mm2 = math.prod(spacing_of(t0))
        source, registered = "repeat", shift_errors_mm
        if detection is None:  # it has the error of the registration in it
            source, registered = "own", (0.0, 0.0)
            detection = _own_detection(left, slopes[0] + slopes[1], kept, smallest, cell_mm2)
        level, lateral, alike_mm2, sigmas = detection
        variance = level + sum(
            (lateral + error**2) * slope
            for error, slope in zip(registered, slopes, strict=True)
        )
        limit = np.where(inside, sigmas * np.sqrt(np.maximum(variance, smallest)), np.nan)
        typical = np.median(limit[inside])
        cluster = max(minimum_points, math.ceil(_CLUSTER * alike_mm2 / cell_mm2))
    change = np.where(inside, difference - datum, np.nan)
    loss, gain = (_spots(sign * change / limit, minimum_points, cluster) for sign in (-1, 1))
    fields = after - datum, change, limit.astype(np.float32), loss, gain
    maps = xr.Dataset(
        {name: (("y", "x"), values) for name, values in zip(_FIELDS, fields, strict=True)},
        coords={axis: t0[axis] for axis in ("y", "x")},
        attrs={
            "level_of_detection_um": float(typical * 1e3),
            "change_sigma_um": float(sigma * 1e3),
            "lateral_sigma_um": float(np.sqrt(lateral) * 1e3),
            "known_fraction": float(inside.mean()),
            "detection": source,
            "alike_um2": float(alike_mm2 * 1e6),
            "cluster_points": int(cluster),
        },
    )
    return described(maps, _FIELDS)


def wear_summary(registered: xr.Dataset) -> dict[str, float]:
    """The extent of the traces on one patch, given a dataset as from `height_change`.

    ``loss_fraction`` and ``gain_fraction``: shares of the known points that lost and gained height
    (equal for noise alone); ``loss_area_mm2``; ``loss_volume_um3``; ``mean_depth_where_worn_um``:
    mean depth where lost (NaN without loss); ``mean_wear_depth_um``: volume over the known area,
    comparable between patches with different overlap; ``noise_fraction``: area that rose over
    area that fell (NaN without loss): noise raises as often as it lowers, so this is the share of
    the loss that it would explain.
    """
    dy, dx = spacing_of(registered)
    change = registered["change"].values
    inside = np.isfinite(change)
    loss, gain = (registered[name].values.astype(bool) & inside for name in ("loss", "gain"))
    lost_um = -change[loss] * 1e3
    share = 1 / inside.sum() if inside.any() else np.nan
    return {
        "loss_fraction": loss.sum() * share,
        "loss_area_mm2": float(loss.sum() * dy * dx),
        "loss_volume_um3": float(lost_um.sum() * dy * dx * 1e6),
        "mean_depth_where_worn_um": float(lost_um.mean()) if lost_um.size else np.nan,
        "mean_wear_depth_um": float(lost_um.sum() * share),
        "gain_fraction": float(gain.sum() * share),
        "noise_fraction": float(gain.sum() / loss.sum()) if loss.any() else np.nan,
    }


def _spots(excess: np.ndarray, minimum_points: int, cluster_points: int) -> np.ndarray:
    """The points beyond the level of detection in spots that count; corners count as adjacent.

    `excess` is the change over the level of detection.
    """
    # ASSUME: use leaves spots of several points; smaller spots beyond the level of detection are
    # noise, though some may be true.
    spot, _ = scipy.ndimage.label(excess > 1, np.ones((3, 3)))
    size = np.bincount(spot.ravel())
    counts = size >= cluster_points
    if cluster_points > minimum_points:
        deep = np.bincount(spot[excess > _DEEP], minlength=size.size)
        counts |= (size >= minimum_points) & (deep > size / 2)
    counts[0] = False
    return counts[spot]


def _own_detection(
    left: np.ndarray, steepness: np.ndarray, kept: np.ndarray, smallest: float, cell_mm2: float
) -> Detection:
    """The error of a change (NaN if unknown) from its unchanged part, of which `kept` marks some.

    Its variance is at least `smallest`.
    """
    inside = np.isfinite(left)
    level, lateral = _variance_by_slope(left[inside], steepness[inside], kept)
    error = np.sqrt(np.maximum(level + lateral * steepness, smallest))
    alike_mm2 = _alike_points(left / error) * cell_mm2
    return Detection(level, lateral, alike_mm2, _LEVEL_OF_DETECTION)


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
    products, pairs = (
        scipy.fft.irfft2(np.abs(scipy.fft.rfft2(field, size)) ** 2, size)
        for field in (centred, kept.astype(float))
    )
    lags = np.ix_(*(np.arange(-far, far + 1) for far in reach))
    covariance = products[lags] / np.maximum(pairs[lags], 1.0)
    return float(np.sum(covariance > _ALIKE * covariance[*reach]) - 1)


def _squared_slopes(surface: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    """Squared slopes along y and x of smoothed heights, free of single points' noise."""
    dy, dx = spacing_of(surface)
    heights = surface.values
    rise_y = scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=(1, 0))
    rise_x = scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=(0, 1))
    return (rise_y / dy) ** 2, (rise_x / dx) ** 2


def _variance_by_slope(
    change: np.ndarray, steepness: np.ndarray, kept: np.ndarray
) -> tuple[float, float]:
    """Variance of the change on level ground (mm²), and its growth with the squared slope (mm²).

    The arrays (n,) are those of the known points; `kept` marks the unchanged ones, to begin with.
    """
    spread = MAD_TO_SIGMA * float(np.median(np.abs(change[kept])))
    level, lateral = spread**2, 0.0
    count = max(1, min(_SLOPE_GROUPS, change.size // _GROUP_SIZE))
    edges = np.quantile(steepness, np.linspace(0, 1, count + 1)[1:-1])
    group = np.searchsorted(edges, steepness)
    for _ in range(_SLOPE_ROUNDS):
        points = pd.DataFrame({"slope": steepness[kept], "change": np.abs(change[kept])})
        groups = points.groupby(group[kept])
        is_large = groups.size() >= _GROUP_SIZE / 2
        typical = groups.agg({"slope": "mean", "change": "median"})[is_large]
        slopes = typical.slope.values
        variances = (MAD_TO_SIGMA * typical.change.values) ** 2
        if len(typical) < _LEAST_GROUPS or not variances.any():
            break
        scale = float(slopes.max()) or 1.0
        # the error of a variance is proportional to it; the fitted variance is used, because the
        # measured one would favour groups that came out small
        weight = 1 / np.maximum(level + lateral * slopes, _SMALLEST * variances.max())
        design = np.stack([weight, weight * slopes / scale], axis=1)
        (level, lateral), _ = scipy.optimize.nnls(design, weight * variances)
        lateral /= scale
        # steep points may be off by more than the fit of the plane allows
        kept = np.abs(change) <= _TRIM * np.sqrt(level + lateral * steepness)
    return float(level), float(lateral)


def _unchanged_plane(
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
        ordered = np.sort(left)
        lengths = ordered[left.size // 2 :] - ordered[: left.size - left.size // 2]
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
        if (now == kept).all() or now.sum() < 3:
            break
        kept = now
        plane = least_squares(design[:, kept], values[kept])
    return plane, sigma, kept
