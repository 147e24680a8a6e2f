"""What did use take away? The height change between two aligned measurements of one patch.

Every measurement has its own zero and its own tilt, so a change is only defined against what did
not change: the plane of the difference is fitted to the largest population of points that agree
with each other. A change counts where it exceeds the level of detection, as in the comparison of
repeat surveys (Brasington et al. 2003, Geomorphology 53:299; Wheaton et al. 2010, Earth Surf.
Process. Landf. 35:136).
"""

import numpy as np
import xarray as xr

from gstlib.surface import spacing_of

__all__ = ["height_change", "wear_summary"]

# ASSUME: LoD95 = 1.96 robust standard deviations of the height difference on the unchanged part,
# one value per patch; noise of both scans and what registration leaves are in it, and about
# 2.5 % of unchanged points exceed it on either side.
_LEVEL_OF_DETECTION = 1.96
# Points further than this from the plane, in standard deviations, are no part of the fit.
_TRIM = 3.0
_MAD_TO_SIGMA = 1.4826
# The trimmed set settles in a few rounds, or soon alternates; the bound only guards against more.
_ROUNDS = 50


def height_change(t0: xr.DataArray, t1_on_t0: xr.DataArray) -> xr.Dataset:
    """Height change from T0 to T1, levelled on the unchanged part.

    Parameters
    ----------
    t0 : (y, x) xarray.DataArray
        Heights before use, mm.
    t1_on_t0 : (y, x) xarray.DataArray
        Heights after use on the same grid, mm, NaN outside the overlap.

    Returns
    -------
    xarray.Dataset
        ``t1``: heights after use (mm), shifted and tilted to agree with T0 where nothing changed;
        ``change``: T1 - T0 (mm), negative where material went; both NaN outside the overlap;
        ``loss``: whether the change is below minus the level of detection. Attributes:
        ``level_of_detection_um``, ``change_sigma_um`` (robust standard deviation of the unchanged
        part), ``unchanged_share`` (of the overlap that the fit rests on).

    Raises
    ------
    ValueError
        The grids differ, or fewer than 100 points are in the overlap.
    """
    if t0.shape != t1_on_t0.shape:
        raise ValueError(f"T0 has shape {t0.shape}, T1 on its grid {t1_on_t0.shape}")
    difference = np.asarray(t1_on_t0, dtype=float) - np.asarray(t0, dtype=float)
    inside = np.isfinite(difference)
    if inside.sum() < 100:
        raise ValueError(f"only {int(inside.sum())} points are in the overlap of T0 and T1")
    rows, columns = np.nonzero(inside)
    design = np.stack(
        [np.ones(rows.size), rows / difference.shape[0] - 0.5, columns / difference.shape[1] - 0.5]
    )
    plane, sigma, kept = _unchanged_plane(design, difference[inside])
    datum = np.full(difference.shape, np.nan)
    datum[inside] = plane @ design
    change = difference - datum
    limit = _LEVEL_OF_DETECTION * sigma

    def variable(values: np.ndarray, units: str, long_name: str) -> tuple:
        return ("y", "x"), values, {"units": units, "long_name": long_name}

    return xr.Dataset(
        {
            "t1": variable(
                np.asarray(t1_on_t0, dtype=float) - datum, "mm", "height at T1 on the grid of T0"
            ),
            "change": variable(change, "mm", "height change from T0 to T1"),
            "loss": variable(
                np.nan_to_num(change) < -limit, "1", "height loss beyond the level of detection"
            ),
        },
        coords={axis: t0[axis] for axis in ("y", "x")},
        attrs={
            "level_of_detection_um": limit * 1e3,
            "change_sigma_um": sigma * 1e3,
            "unchanged_share": float(kept.mean()),
        },
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
        ``loss_fraction``: share of the overlap that lost height; ``loss_area_mm2``;
        ``loss_volume_um3``; ``loss_depth_um``: mean depth where lost (NaN without loss);
        ``loss_per_area_um``: volume over the overlap's area, comparable between patches of
        different overlap; ``gain_fraction``: share that rose by more than the level of detection,
        which says how much of the loss noise alone would give.
    """
    dy, dx = spacing_of(registered)
    change = registered["change"].values
    inside = np.isfinite(change)
    loss = registered["loss"].values.astype(bool) & inside
    limit = registered.attrs["level_of_detection_um"] * 1e-3
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
        "gain_fraction": float((change[inside] > limit).sum() * share),
    }


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
        left = values - plane @ design
        centre, sigma = _shortest_half(left)
        now = np.abs(left - centre) <= _TRIM * sigma
        # settled, or in turns the one and the other of two sets a few points apart
        if (now == kept).all() or (now == before).all():
            break
        before, kept = kept, now
        plane = _least_squares(design[:, kept], values[kept])
    # the shortest half is wide where much has worn; what is kept gives the spread of the rest
    for _ in range(_ROUNDS):
        left = values - plane @ design
        sigma = _MAD_TO_SIGMA * float(np.median(np.abs(left[kept] - np.median(left[kept]))))
        now = np.abs(left) <= _TRIM * sigma
        if (now == kept).all() or now.sum() < 3:
            break
        kept = now
        plane = _least_squares(design[:, kept], values[kept])
    return plane, sigma, kept


def _least_squares(design: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(design @ design.T, design @ values, rcond=None)[0]


def _shortest_half(values: np.ndarray) -> tuple[float, float]:
    """Middle of the shortest interval that holds half of the values, and the sigma it implies."""
    ordered = np.sort(values)
    half = ordered.size // 2
    lengths = ordered[half:] - ordered[: ordered.size - half]
    start = int(np.argmin(lengths))
    # half of a normal population lies within 0.6745 sigma of its mean
    return float(ordered[start] + lengths[start] / 2), float(lengths[start] / 2 / 0.6745)
