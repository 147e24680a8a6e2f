"""What did use take away? The height change between two aligned measurements of one patch.

Every measurement has its own zero and its own tilt, so a change is only defined against what did
not change: the plane of the difference is fitted to the largest population of points that agree
with each other. A change counts where it exceeds the level of detection, as in the comparison of
repeat surveys (Brasington et al. 2003, Geomorphology 53:299; Wheaton et al. 2010, Earth Surf.
Process. Landf. 35:136), and where enough points beside each other do.

The error of a point is that of both heights and, on a slope, that of its place: its variance is
fitted to the unchanged part as a + b s², s being the slope (Hugonnet et al. 2022, IEEE J. Sel. Top.
Appl. Earth Obs. 15:6456, do so for repeat surveys); √b is how far, sideways, the two measurements
miss each other. Points without a height of their own at either epoch (unmeasured, outliers) are
not known: no change is stated there.
"""

import numpy as np
import scipy.ndimage
import scipy.optimize
import xarray as xr

from gstlib.surface import spacing_of
from gstlib.validation.registration import (
    Registration,
    apply_registration,
    carry_mask,
    register,
)

__all__ = ["height_change", "measured_change", "no_change", "wear_summary"]

# ASSUME: LoD95 = 1.96 standard deviations of the height difference on the unchanged part at the
# slope of the point; noise of both scans and what registration leaves are in it, and about 2.5 % of
# unchanged points exceed it on either side.
_LEVEL_OF_DETECTION = 1.96
# ASSUME: two measurements are told apart no finer than instruments store heights: in single
# precision, 1e-7 of what they vary by. Below that lies rounding alone, which of a scan that was
# given twice would make traces.
_RESOLUTION = 1e-7
# Points further than this from the plane, in standard deviations, are no part of the fit.
_TRIM = 3.0
_MAD_TO_SIGMA = 1.4826
# The trimmed set settles in a few rounds, or soon alternates; the bound only guards against more.
_ROUNDS = 50
# The variance is taken of so many groups of points of like slope, and fitted again this often.
_SLOPE_GROUPS, _SLOPE_ROUNDS = 20, 3
# A group's variance is good to about a tenth; with fewer groups there is nothing to fit to.
_GROUP_SIZE, _LEAST_GROUPS = 250, 4
# Fitted variances below this share of the largest one are taken for so much in weighing.
_SMALLEST = 1e-6
# Slopes are those of heights smoothed over so many points: of one point alone, they are noise.
_SLOPE_SMOOTHING = 1.0
_LEAST_POINTS = 100
# Points that touch at a corner belong together.
_NEIGHBOURS = np.ones((3, 3))


def measured_change(
    before: xr.Dataset, after: xr.Dataset, *, maximum_shift_mm: float, minimum_points: int
) -> tuple[Registration, xr.Dataset]:
    """Lay T1 over T0 and take the height change.

    Parameters
    ----------
    before, after : xarray.Dataset
        Prepared scans (`gstlib.preprocess.scan.prepare_scan`): ``height``, ``filled``, ``outlier``.
    maximum_shift_mm : float
        As of `register`.
    minimum_points : int
        As of `height_change`.

    Returns
    -------
    Registration, xarray.Dataset
        The latter as of `height_change`, or of `no_change` where the registration is not believed
        or fewer than 100 points have a height of their own at both epochs.
    """
    registration = register(before.height, after.height, maximum_shift_mm=maximum_shift_mm)
    if not registration.found:
        return registration, no_change(before.height)
    on_t0 = apply_registration(after.height, registration, like=before.height)
    replaced = carry_mask(_replaced(after), registration, like=before.height)
    known = np.isfinite(on_t0.values) & ~(_replaced(before).values | replaced)
    if known.sum() < _LEAST_POINTS:
        return registration, no_change(before.height)
    return registration, height_change(
        before.height, on_t0, known=known, minimum_points=minimum_points
    )


def _replaced(surface: xr.Dataset) -> xr.DataArray:
    """Points whose height is not their own."""
    return surface.filled.astype(bool) | surface.outlier.astype(bool)


def height_change(
    t0: xr.DataArray,
    t1_on_t0: xr.DataArray,
    known: np.ndarray | None = None,
    *,
    minimum_points: int = 1,
) -> xr.Dataset:
    """Height change from T0 to T1, levelled on the unchanged part.

    Parameters
    ----------
    t0 : (y, x) xarray.DataArray
        Heights before use, mm.
    t1_on_t0 : (y, x) xarray.DataArray
        Heights after use on the same grid, mm, NaN outside the overlap.
    known : (y, x) array_like of bool, optional
        Where both heights were measured, not replaced; everywhere by default.
    minimum_points : int
        Least points beside each other (corners count) that make a loss or a gain.

    Returns
    -------
    xarray.Dataset
        ``t1``: heights after use (mm), shifted and tilted to agree with T0 where nothing changed,
        NaN outside the overlap; ``change``: T1 - T0 (mm), negative where material went, NaN where
        it is not known; ``level_of_detection`` (mm), NaN there too; ``loss``, ``gain``: whether
        the change is beyond the level of detection, down or up, in spots of `minimum_points` at
        least. Attributes: ``level_of_detection_um`` (median over the points),
        ``change_sigma_um`` (robust standard deviation of the unchanged part),
        ``lateral_sigma_um`` (how far the measurements miss each other sideways, as the slopes
        tell), ``unchanged_share`` (of the known points, that the fit rests on), ``known_share``
        (of T0's area), ``minimum_points``.

    Raises
    ------
    ValueError
        The grids differ, or fewer than 100 points are known at both epochs.
    """
    if t0.shape != t1_on_t0.shape:
        raise ValueError(f"T0 has shape {t0.shape}, T1 on its grid {t1_on_t0.shape}")
    before, after = np.asarray(t0, dtype=float), np.asarray(t1_on_t0, dtype=float)
    difference = after - before
    inside = np.isfinite(difference)
    if known is not None:
        inside &= np.asarray(known, dtype=bool)
    if inside.sum() < _LEAST_POINTS:
        raise ValueError(f"only {int(inside.sum())} points are in the overlap of T0 and T1")
    rows, columns = np.indices(difference.shape)
    places = np.stack(
        [
            np.ones(difference.shape),
            rows / difference.shape[0] - 0.5,
            columns / difference.shape[1] - 0.5,
        ]
    )
    plane, sigma, kept = _unchanged_plane(places[:, inside], difference[inside])
    datum = np.einsum("i,ijk->jk", plane, places)
    change = np.where(inside, difference - datum, np.nan)
    steepness = _squared_slope(before, spacing_of(t0))
    level, lateral = _variance_by_slope(change[inside], steepness[inside], kept)
    resolution = _RESOLUTION * before[inside].std()
    variance = np.maximum(level + lateral * steepness, resolution**2)
    variance[~inside] = np.nan
    limit = _LEVEL_OF_DETECTION * np.sqrt(variance)
    return _dataset(
        t0,
        t1=after - datum,
        change=change,
        limit=limit,
        loss=_spots(change < -limit, minimum_points),
        gain=_spots(change > limit, minimum_points),
        level_of_detection_um=float(np.median(limit[inside])) * 1e3,
        change_sigma_um=sigma * 1e3,
        lateral_sigma_um=float(np.sqrt(lateral)) * 1e3,
        unchanged_share=float(kept.mean()),
        known_share=float(inside.mean()),
        minimum_points=minimum_points,
    )


def no_change(t0: xr.DataArray) -> xr.Dataset:
    """What `height_change` would give without a point measured at both epochs."""
    nowhere = np.full(t0.shape, np.nan)
    names = ("level_of_detection_um", "change_sigma_um", "lateral_sigma_um", "unchanged_share")
    return _dataset(
        t0,
        t1=nowhere,
        change=nowhere,
        limit=nowhere,
        loss=np.zeros(t0.shape, dtype=bool),
        gain=np.zeros(t0.shape, dtype=bool),
        **dict.fromkeys(names, np.nan),
        known_share=0.0,
    )


def _dataset(t0: xr.DataArray, *, t1, change, limit, loss, gain, **attrs) -> xr.Dataset:
    def variable(values: np.ndarray, units: str, long_name: str) -> tuple:
        return ("y", "x"), values, {"units": units, "long_name": long_name}

    return xr.Dataset(
        {
            "t1": variable(t1, "mm", "height at T1 on the grid of T0"),
            "change": variable(change, "mm", "height change from T0 to T1"),
            "level_of_detection": variable(
                limit, "mm", "height change that noise exceeds on one point in twenty"
            ),
            "loss": variable(loss, "1", "height loss beyond the level of detection"),
            "gain": variable(gain, "1", "height gain beyond the level of detection"),
        },
        coords={axis: t0[axis] for axis in ("y", "x")},
        attrs=attrs,
    )


def wear_summary(registered: xr.Dataset) -> dict[str, float]:
    """How far the traces extend on one patch.

    Parameters
    ----------
    registered : xarray.Dataset
        As from `height_change`.

    Returns
    -------
    dict
        ``loss_fraction``: share of the known points that lost height; ``loss_area_mm2``;
        ``loss_volume_um3``; ``loss_depth_um``: mean depth where lost (NaN without loss);
        ``loss_per_area_um``: volume over the known area, comparable between patches of
        different overlap; ``gain_fraction``: share that rose, which says how much of the loss
        noise alone would give.
    """
    dy, dx = spacing_of(registered)
    change = registered["change"].values
    inside = np.isfinite(change)
    loss, gain = (registered[name].values.astype(bool) & inside for name in ("loss", "gain"))
    lost_um = -change[loss] * 1e3
    element_um2 = dy * dx * 1e6
    measured = int(inside.sum())
    share = 1 / measured if measured else np.nan
    return {
        "loss_fraction": loss.sum() * share,
        "loss_area_mm2": float(loss.sum() * dy * dx),
        "loss_volume_um3": float(lost_um.sum() * element_um2),
        "loss_depth_um": float(lost_um.mean()) if lost_um.size else np.nan,
        "loss_per_area_um": float(lost_um.sum() * share),
        "gain_fraction": float(gain.sum() * share),
    }


def _spots(beyond: np.ndarray, minimum_points: int) -> np.ndarray:
    """The points of `beyond` that have enough others of it beside them."""
    # ASSUME: what changes a stone leaves spots of several points; a point or a few beyond the level
    # of detection by themselves are noise, though some may be true.
    if minimum_points <= 1:
        return beyond
    spot, _ = scipy.ndimage.label(beyond, _NEIGHBOURS)
    large = np.bincount(spot.ravel()) >= minimum_points
    large[0] = False
    return large[spot]


def _squared_slope(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """Square of the slope of smoothed heights; a point's own noise has no part in it."""
    return sum(
        (scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=order) / step) ** 2
        for order, step in zip(((1, 0), (0, 1)), spacing, strict=True)
    )


def _variance_by_slope(
    change: np.ndarray, steepness: np.ndarray, kept: np.ndarray
) -> tuple[float, float]:
    """Variance on the level (mm²) and what it grows by with the squared slope (mm²).

    Parameters
    ----------
    change, steepness : (n,) ndarray
        Height change, mm, of the known points, and their squared slopes.
    kept : (n,) ndarray of bool
        The unchanged ones among them, to begin with.
    """
    level, lateral = (_MAD_TO_SIGMA * float(np.median(np.abs(change[kept])))) ** 2, 0.0
    groups = min(_SLOPE_GROUPS, change.size // _GROUP_SIZE)
    edges = np.quantile(steepness, np.linspace(0, 1, groups + 1)[1:-1]) if groups else []
    group = np.searchsorted(edges, steepness)
    ends = np.cumsum(np.bincount(group, minlength=1))[:-1]
    members = np.split(np.argsort(group, kind="stable"), ends)
    for _ in range(_SLOPE_ROUNDS):
        found = [
            (np.mean(steepness[member]), (_MAD_TO_SIGMA * np.median(np.abs(change[member]))) ** 2)
            for member in (each[kept[each]] for each in members)
            if member.size >= _GROUP_SIZE / 2
        ]
        slopes, variances = np.array(found).reshape(-1, 2).T
        if len(found) < _LEAST_GROUPS or not variances.any():
            break
        scale = float(slopes.max()) or 1.0
        # the error of a variance is in proportion to it: to the fitted one, for the measured one
        # would favour those that came out small
        weight = 1 / np.maximum(level + lateral * slopes, _SMALLEST * variances.max())
        (level, lateral), _ = scipy.optimize.nnls(
            np.stack([weight, weight * slopes / scale], axis=1), weight * variances
        )
        lateral /= scale
        # what is steep may be off by more than the fit of the plane allowed
        kept = np.abs(change) <= _TRIM * np.sqrt(level + lateral * steepness)
    return float(level), float(lateral)


def _unchanged_plane(
    design: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Plane through the unchanged points, their robust spread, and which they are."""
    # ASSUME: the unchanged part is the largest population of height differences: the fit starts
    # from the shortest half of them, so wear of nearly half of the area, all on one side, does not
    # pull the datum down as a least-squares plane would.
    plane = np.array([np.median(values), 0.0, 0.0])
    kept = np.zeros(values.size, dtype=bool)
    before = kept
    sigma = np.inf
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        centre, sigma = _shortest_half(left)
        now = np.abs(left - centre) <= _TRIM * sigma
        # settled, or in turns the one and the other of two sets a few points apart
        if (now == kept).all() or (now == before).all():
            break
        before, kept = kept, now
        plane = _least_squares(design[:, kept], values[kept])
    # the shortest half is wide where much has worn; what is kept gives the spread of the rest
    for _ in range(_ROUNDS):
        left = values - np.einsum("i,ij->j", plane, design)
        sigma = _MAD_TO_SIGMA * float(np.median(np.abs(left[kept] - np.median(left[kept]))))
        now = np.abs(left) <= _TRIM * sigma
        if (now == kept).all() or now.sum() < 3:
            break
        kept = now
        plane = _least_squares(design[:, kept], values[kept])
    return plane, sigma, kept


def _least_squares(design: np.ndarray, values: np.ndarray) -> np.ndarray:
    # einsum, not a product of matrices: BLAS adds up in an order that changes from run to run
    normal = np.einsum("ik,jk->ij", design, design)
    return np.linalg.lstsq(normal, np.einsum("ik,k->i", design, values), rcond=None)[0]


def _shortest_half(values: np.ndarray) -> tuple[float, float]:
    """Middle of the shortest interval that holds half of the values, and the sigma it implies."""
    ordered = np.sort(values)
    half = ordered.size // 2
    lengths = ordered[half:] - ordered[: ordered.size - half]
    start = int(np.argmin(lengths))
    # half of a normal population lies within 0.6745 sigma of its mean
    return float(ordered[start] + lengths[start] / 2), float(lengths[start] / 2 / 0.6745)
