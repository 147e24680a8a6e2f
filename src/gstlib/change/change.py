"""The height change of a patch in use, between two aligned measurements.

Every measurement has its own zero and its own tilt. So a change is relative to the unchanged part.
The plane of the difference is fitted to the largest population of points that agree with each
other. A change counts if it exceeds the level of detection at enough adjacent points. Repeat
surveys are compared in this way, too (Brasington et al. 2003, Geomorphology 53:299; Wheaton et al.
2010, Earth Surf. Process. Landf. 35:136).

Points whose height was not measured at both epochs (filled holes, outliers) have an unknown change.

A patch that was scanned twice without use in between shows the same error without wear. Such
repeats give a, b and the extent of correlation for all patches, and no patch scores its own repeat.
"""

import logging
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gstlib.change import noise
from gstlib.change.noise import Detection
from gstlib.change.registration import apply_registration, is_other, register
from gstlib.change.search import LEAST_POINTS
from gstlib.errors import InputError
from gstlib.surfaces.grid import described, spacing_of

__all__ = [
    "SCAN_FIELDS",
    "Detection",
    "estimate_detection_limit",
    "height_change",
    "measured_change",
    "register_patch",
    "wear_summary",
]

_log = logging.getLogger(__name__)

# Fields of a prepared scan for registration and change.
SCAN_FIELDS = ["height", "filled", "outlier"]

_TINY = np.finfo(float).tiny
# Ratio of the dale depths of T1 and T0 beyond which a warning is issued. Wear of a quarter of a
# patch makes them a tenth shallower (synthetic specimen).
_ODD_HEIGHTS = 1.25
# ASSUME: Changed repeats. A repeat shows a worn surface if its areas of loss and gain differ by
# more than 0.5 % of the patch, and by more than the smaller area. Reason: Noise marks as much loss
# as gain.
_CHANGED = 0.005
# Units and meanings of the maps of a change.
_FIELDS = {
    "t1": ("mm", "height at T1 on the grid of T0"),
    "change": ("mm", "height change from T0 to T1"),
    "level_of_detection": (
        "mm",
        "height change that noise exceeds on one point in twenty",
    ),
    "loss": ("1", "height loss beyond the level of detection"),
    "gain": ("1", "height gain beyond the level of detection"),
}
# Ratio of the scatter of the unchanged part to the scatter of repeats beyond which a warning is
# issued.
_ODD_SCATTER = 2.0
# Rounding limits the detection if it alone makes this share of the level of detection.
_ROUNDED = 0.7


def estimate_detection_limit(
    before: Mapping[str, xr.Dataset], again: Mapping[str, xr.Dataset], **search: Any
) -> Detection | None:
    """The error of a height change, from patches that were scanned twice without use in between.

    Each second scan is registered to the first like T1 to T0. All remaining differences are error.
    Its variance is fitted to the points of all patches together.

    Parameters
    ----------
    before, again : mapping of str to xarray.Dataset
        The two prepared scans by patch, as in `measured_change`; each is looked up once. The
        patches are the keys of `again`.
    **search
        ``maximum_shift_mm`` and ``minimum_cluster_points`` of `measured_change`.

    Returns
    -------
    Detection or None
        None without a valid pair. A pair is left out, with a warning, if the second scan is not
        registered to the first, or if the surface changed in between.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> rng = np.random.default_rng(1)
    >>> stone = gstlib.self_affine_field(rng, 96, 0.01, hurst_exponent=0.8, roll_off=0.1)
    >>> noisy = 0.02 * stone + 1e-4 * rng.normal(size=(2, 96, 96))
    >>> once, again = (gstlib.prepare_scan(gstlib.make_surface(h, 0.01)) for h in noisy)
    >>> search = {"maximum_shift_mm": 0.1, "minimum_cluster_points": 8}
    >>> detection = gstlib.estimate_detection_limit({"7": once}, {"7": again}, **search)
    >>> round(1e3 * detection.level_mm2**0.5, 2)  # µm, of the difference
    0.14
    """
    repeats, alike_um2 = [], 0.0
    for patch in again:
        first = before[patch]
        try:
            change = measured_change(first, again[patch], **search)
            fault = _no_repeat(change)
        except InputError as error:
            fault = error.problem
        if fault is not None:
            _log.warning(
                "patch %s: its repeat is not used, because %s. Give a second scan of the surface "
                "that t0 shows, or leave repeat empty in the patch table.",
                patch,
                fault,
            )
            continue
        steepness = noise.squared_slopes(first.height).sum(axis=0)
        heights = change["change"].values
        repeats.append(np.stack([heights, steepness])[:, np.isfinite(heights)])
        alike_um2 = max(alike_um2, change.attrs["alike_um2"])
    if not repeats:
        return None
    pooled, steepness = np.concatenate(repeats, axis=1)
    # ASSUME: Errors of a repeat. A repeat has the errors of T1: taken off, put back, and scanned
    # with the same settings. Its whole surface is unchanged, and points off by more than three
    # standard deviations are outliers. Reason: The tool was not used between the two scans.
    everywhere = np.ones(pooled.size, dtype=bool)
    level, lateral = noise.variance_by_slope(pooled, steepness, everywhere)
    # The errors of instruments have longer tails than normal errors.
    squares = pooled**2 / np.maximum(level + lateral * steepness, _TINY)
    limit = max(noise.LEVEL_OF_DETECTION, math.sqrt(np.quantile(squares, 0.95)))
    return Detection(level, lateral, alike_um2 * 1e-6, limit)


def _no_repeat(change: xr.Dataset) -> str | None:
    """The reason why a second scan does not show the error of the first, or None."""
    facts = change.attrs
    if not facts["registration_found"]:
        return "it was not found on t0"
    if not facts["known_fraction"]:
        return "almost no point was measured in both scans"
    if is_other(facts["dale_depth_ratio"], _ODD_HEIGHTS):
        return f"its dales are {facts['dale_depth_ratio']:.3g} times as deep as the dales of t0"
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
    minimum_cluster_points: int,
    detection: Detection | None = None,
) -> xr.Dataset:
    """Register T1 to T0 and compute the height change.

    `before` and `after` are prepared scans (`gstlib.preprocess.scans.prepare_scan`): ``height``,
    ``filled``, ``outlier``. Other parameters are as in `register` and `height_change`. The result
    is the result of `height_change`, and its attributes also contain the registration (see
    `gstlib.change.registration.Registration`). The whole change is unknown if T1 was not
    registered.
    """
    t0, t1 = before.height, after.height
    registration = register(t0, t1, maximum_shift_mm=maximum_shift_mm)
    replaced0, replaced1 = map(_replaced, (before, after))
    on_t0, replaced = apply_registration(t1, replaced1, registration, like=t0)
    errors_mm = registration.shift_y_error_mm, registration.shift_x_error_mm
    change = height_change(
        t0,
        on_t0,
        ~(replaced0 | replaced) & registration.is_reliable,
        minimum_cluster_points=minimum_cluster_points,
        detection=detection,
        shift_errors_mm=np.nan_to_num(errors_mm),
        rounding_mm=_rounding_mm(before, after),
    )
    return change.assign_attrs(registration.as_attrs())


def _replaced(scan: xr.Dataset) -> np.ndarray:
    """Mask (ny, nx) of the points of a prepared scan whose height was not measured."""
    return (scan.filled.astype(bool) | scan.outlier.astype(bool)).values


def _rounding_mm(before: xr.Dataset, after: xr.Dataset) -> float:
    """Standard deviation of a height change from the steps in which both heights were stored."""
    steps_um = (epoch.attrs.get("height_step_um", 0.0) for epoch in (before, after))
    return math.hypot(*steps_um) * 1e-3 / math.sqrt(12)


def register_patch(
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    patch: str,
    detection: Detection | None = None,
    **search: Any,
) -> xr.Dataset:
    """Register T1 to T0 and compute the height change, and warn of odd changes.

    The parameters are those of `measured_change`, and the name of the `patch`.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> rng = np.random.default_rng(1)
    >>> stone = gstlib.self_affine_field(rng, 96, 0.01, hurst_exponent=0.8, roll_off=0.1)
    >>> worn = np.minimum(stone, np.quantile(stone, 0.9))
    >>> heights = 0.02 * stone, 0.02 * np.roll(worn, 3, axis=1)
    >>> t0, t1 = (gstlib.prepare_scan(gstlib.make_surface(h, 0.01)) for h in heights)
    >>> search = {"maximum_shift_mm": 0.1, "minimum_cluster_points": 8}
    >>> change = gstlib.register_patch(t0, t1, patch="7", **search)
    >>> round(change.attrs["shift_x_um"]), round(float(change.loss.mean()), 2)
    (-30, 0.09)
    """
    try:
        change = measured_change(before, after, detection=detection, **search)
    except InputError as error:  # it names the epoch, but not the patch
        raise error.about(f"patch {patch}, {error.source}", error.problem) from error
    if change.attrs["registration_found"]:
        for doubt in _doubts(before, after, change, detection):
            _log.warning("patch %s: %s", patch, doubt)
    return change


def _doubts(
    before: xr.Dataset,
    after: xr.Dataset,
    change: xr.Dataset,
    detection: Detection | None,
) -> Iterator[str]:
    """Warnings about a patch whose T1 was registered to its T0."""
    facts = change.attrs
    ratio = facts["dale_depth_ratio"]
    # a larger ratio is a fault, which `selection.other_heights` reports
    if is_other(ratio, _ODD_HEIGHTS) and not is_other(ratio):
        yield (
            f"its dales at T1 are {ratio:.3g} times as deep as at T0. If the whole patch did not "
            "wear, one scan has another height calibration, and measured wear is wrong"
        )
    if not facts["known_fraction"]:
        holes0, holes1 = (100 * _replaced(scan).mean() for scan in (before, after))
        yield (
            "almost no point was measured at both T0 and T1, so its wear is unknown. Of the scans, "
            f"{holes0:.0f} % and {holes1:.0f} % are holes or outliers, and T1 covers "
            f"{100 * facts['overlap']:.0f} % of T0. Scan it again, or leave its t1 empty."
        )
        return
    detectable_um = facts["level_of_detection_um"]
    limit_um = noise.LEVEL_OF_DETECTION * 1e3 * _rounding_mm(before, after)
    if limit_um > _ROUNDED * detectable_um:
        step_um = max(scan.attrs["height_step_um"] for scan in (before, after))
        yield (
            f"its heights are stored in steps of up to {step_um:.3g} µm, so changes below "
            f"{limit_um:.2g} µm cannot be seen. Export the scans with more digits"
        )
    if detection is None:
        return
    scatter = facts["change_sigma_um"] * detection.limit / detectable_um
    if scatter > _ODD_SCATTER:
        yield (
            f"its least changed part differs between T0 and T1 by {scatter:.3g} times the error of "
            "repeated scans. If the whole patch did not wear, T1 was scanned in another way than "
            "the repeats, and much of its loss and gain is error"
        )


def height_change(
    t0: xr.DataArray,
    t1_on_t0: xr.DataArray,
    measured: np.ndarray | bool = True,
    *,
    minimum_cluster_points: int = 1,
    detection: Detection | None = None,
    shift_errors_mm: ArrayLike = (0.0, 0.0),
    rounding_mm: float = 0.0,
) -> xr.Dataset:
    """Height change from T0 to T1, levelled on the unchanged part.

    Parameters
    ----------
    t0, t1_on_t0 : (y, x) xarray.DataArray
        Heights before and after use on one grid, mm; after use NaN outside the overlap.
    measured : (y, x) ndarray of bool, or bool
        Whether both heights were measured.
    minimum_cluster_points : int
        Fewest adjacent points (corners count) that are a loss or a gain. If the errors of
        neighbouring points correlate, clusters must be larger or deeper.
    detection : Detection, optional
        The error of a change from repeated scans, from `estimate_detection_limit`. By default, it
        is fitted to the unchanged part.
    shift_errors_mm : (float, float)
        Standard errors (y, x) of the registration, mm, which add to the error of repeated scans.
    rounding_mm : float
        Smallest standard deviation of the change, mm, because stored heights are rounded.

    Returns
    -------
    xarray.Dataset
        ``t1``: heights after use (mm), shifted and tilted to agree with T0 in the unchanged part,
        NaN outside the overlap. ``change``: T1 - T0 (mm), negative for a loss, and
        ``level_of_detection`` (mm, float32), NaN if unknown. ``loss``, ``gain``: whether the change
        exceeds that level, down or up, in spots of at least `minimum_cluster_points`. Attributes:
        ``level_of_detection_um`` (median), ``change_sigma_um`` (robust standard deviation of the
        unchanged part), ``lateral_sigma_um`` (lateral misfit of the measurements),
        ``known_fraction`` (of T0's area), ``detection`` (source of the level: ``repeat``, ``own``
        or empty), ``alike_um2`` (area around a point with correlated errors), ``cluster_points``.
        With fewer than 100 known points, all heights are NaN.
    """
    before, after = t0.values, t1_on_t0.values
    difference = after - before
    inside = np.isfinite(difference) & measured
    datum, change, limit = np.full((3, *t0.shape), np.nan)
    source, cluster, sigma, typical = "", minimum_cluster_points, np.nan, np.nan
    if inside.sum() < LEAST_POINTS:
        inside[:], detection = False, Detection(*4 * [np.nan])
    else:
        datum, sigma, kept = noise.unchanged_plane(difference, inside)
        change = np.where(inside, difference - datum, np.nan)
        slopes, cell_mm2 = noise.squared_slopes(t0), math.prod(spacing_of(t0))
        smallest = max(noise.RESOLUTION * before[inside].std(), rounding_mm) ** 2
        source = "own" if detection is None else "repeat"
        if detection is None:
            steepness, shift_errors_mm = (
                slopes.sum(axis=0),
                (0.0, 0.0),
            )  # it has them in it
            detection = noise.own_detection(change, steepness, kept, smallest, cell_mm2)
        lateral = detection.lateral_mm2 + np.square(shift_errors_mm)
        variance = detection.level_mm2 + np.einsum("i,ijk->jk", lateral, slopes)
        detectable = detection.limit * np.sqrt(np.maximum(variance, smallest))
        limit = np.where(inside, detectable, np.nan)
        typical = np.median(limit[inside])
        alike = math.ceil(noise.CLUSTER * detection.alike_mm2 / cell_mm2)
        cluster = max(minimum_cluster_points, alike)
    fields = {
        "t1": after - datum,
        "change": change,
        "level_of_detection": limit.astype(np.float32),
        "loss": noise.spots(-change / limit, minimum_cluster_points, cluster),
        "gain": noise.spots(change / limit, minimum_cluster_points, cluster),
    }
    maps = xr.Dataset(
        {name: (("y", "x"), values) for name, values in fields.items()},
        coords={axis: t0[axis] for axis in ("y", "x")},
        attrs={
            "level_of_detection_um": typical * 1e3,
            "change_sigma_um": sigma * 1e3,
            "lateral_sigma_um": np.sqrt(detection.lateral_mm2) * 1e3,
            "known_fraction": inside.mean(),
            "detection": source,
            "alike_um2": detection.alike_mm2 * 1e6,
            "cluster_points": cluster,
        },
    )
    return described(maps, _FIELDS)


def wear_summary(registered: xr.Dataset) -> dict[str, float]:
    """The extent of the traces on one patch, from a dataset of `height_change`.

    ``loss_fraction`` and ``gain_fraction``: fractions of the known points that lost and gained
    height (equal for noise alone); ``loss_area_mm2``; ``loss_volume_um3``;
    ``mean_depth_where_worn_um``: mean depth of the loss (NaN without loss); ``mean_wear_depth_um``:
    volume over the known area, comparable between patches with different overlap;
    ``gain_to_loss_ratio``: area of gain over area of loss (infinite for a gain alone, NaN for
    little gain without loss). Noise raises as often as it lowers, so this ratio is the fraction of
    the loss that noise would explain.
    """
    cell_mm2 = math.prod(spacing_of(registered))
    change = registered["change"].values
    loss, gain = (registered[name].values.astype(bool) for name in ("loss", "gain"))
    lost_um = -change[loss] * 1e3
    known = np.isfinite(change).sum()
    share = 1 / known if known else np.nan
    lost, gained = loss.sum() * share, gain.sum() * share
    ratio = np.inf if gained > _CHANGED else np.nan
    if lost > 0:
        ratio = gained / lost
    return {
        "loss_fraction": lost,
        "loss_area_mm2": loss.sum() * cell_mm2,
        "loss_volume_um3": lost_um.sum() * cell_mm2 * 1e6,
        "mean_depth_where_worn_um": lost_um.mean() if lost_um.size else np.nan,
        "mean_wear_depth_um": lost_um.sum() * share,
        "gain_fraction": gained,
        "gain_to_loss_ratio": ratio,
    }
