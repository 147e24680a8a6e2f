"""From a scan as measured to a surface ready for contact, in the same way at both epochs."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.scans import cut_scan, whole_scan
from gstlib.preprocess.outliers import height_step, median_outliers, window_outliers
from gstlib.surfaces.grid import MM_TO_UM, described, spacing_of, spacing_of_heights
from gstlib.surfaces.leveling import remove_plane
from gstlib.surfaces.spectrum import shortest_trusted

__all__ = [
    "check_unmeasured",
    "crop_of",
    "cut_patch",
    "interpolate_holes",
    "mould_of",
    "prepare_patch",
    "prepare_scan",
    "preprocessing_table",
]

# ASSUME: Window of the paper's outlier rule. The window's half-width r is 5 points. Reason: The
# paper does not publish r. With r = 5, a window has 121 points and finds spikes of up to 15 points.
_WINDOW_HALF_WIDTH = 5
# Half-width of the windows of medians. A spike may cover nearly half of their 49 points.
_MEDIAN_HALF_WIDTH = 3

# The preparation of a scan, in the order of the table.
_DONE = [
    "unmeasured",
    "filled",
    "outliers",
    "outlier_k",
    "tilt_x_mrad",
    "tilt_y_mrad",
    "Sq_before_um",
    "Sq_after_um",
    "shortest_trusted_um",
]

# Units and meanings of the maps of a prepared scan.
_FIELDS = {
    "height": ("mm", "height of the stone, level"),
    "filled": ("1", "unmeasured, filled from around it"),
    "outlier": ("1", "outlier, replaced from around it"),
    "measured": ("mm", "height as measured, the mould undone"),
}
# Attributes of a scan as read that are not those of its preparation.
_NOT_KEPT = {"units", "long_name", "unit_stated"}

# ASSUME: Orientation of scans. Once a mould is undone, the rows of a scan run along the square's +y
# and its columns along +x. The rotation of the patch is added. Reason: The paper states which axis
# is flipped, but not how the instrument lies.


def prepare_scan(
    raw: xr.DataArray,
    *,
    mould_invert: bool = False,
    mould_flip: str | None = None,
    maximum_unmeasured: float = 0.1,
    outlier_rule: str = "median",
    outlier_fraction: float = 0.01,
    outlier_median_threshold: float = 5.0,
) -> xr.Dataset:
    """Undo the mould, find the outliers, replace them and the unmeasured points, and level.

    Parameters
    ----------
    raw : (ny, nx) xarray.DataArray
        Heights as measured, mm, NaN where unmeasured.
    mould_invert : bool
        Whether to change the sign of the heights: a mould is a negative.
    mould_flip : {"x", "y", None}
        Axis along which the map is mirrored, because a mould is seen from the other side.
    maximum_unmeasured : float
        Largest share (0 to 1) of unmeasured points accepted.
    outlier_rule : {"window", "median"}
    outlier_fraction
        See `window_outliers`.
    outlier_median_threshold
        See `median_outliers`.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x), mm, level, without NaN. ``filled`` and ``outlier`` (replaced), (y, x)
        bool. ``measured`` (y, x), mm, the heights before this preparation, with the mould undone,
        in single precision. Attributes: ``unmeasured``, ``filled``, ``outliers`` (counts),
        ``outlier_k`` (the rule's threshold), ``outlier_scale_um`` (of `median_outliers`, NaN with
        the other rule), ``tilt_x_mrad``, ``tilt_y_mrad`` (of the plane removed), ``Sq_before_um``
        (r.m.s. of the measured heights about their mean), ``Sq_after_um`` (of the prepared
        heights), ``shortest_trusted_um`` (the shortest wavelength at which they exceed the noise of
        single points), ``height_step_um`` (in which heights were stored, 0 if it is too small to be
        seen), and the texts of the raw scan.

    Raises
    ------
    InputError
        Too many points are unmeasured, or a rule or an axis is unknown.
    ContactInputError
        The scan is no surface: see `gstlib.surfaces.grid.spacing_of_heights`.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> heights = np.random.default_rng(1).normal(0, 1e-3, (40, 40))
    >>> heights[10, 10], heights[20, 20:23] = 0.1, np.nan
    >>> scan = gstlib.prepare_scan(gstlib.make_surface(heights, spacing=2e-3))
    >>> scan.attrs["outliers"], scan.attrs["filled"]
    (1, 3)
    """
    spacing_of_heights(raw)  # refuses what is no surface
    check_unmeasured(raw, maximum_unmeasured)
    if mould_flip not in ("x", "y", None):
        raise InputError("mould_flip", f"is {mould_flip!r}", "Give x, y or None.")
    if outlier_rule not in ("window", "median"):
        remedy = "Give window or median."
        raise InputError("outlier_rule", f"is {outlier_rule!r}", remedy)
    flipped = () if mould_flip is None else raw.dims.index(mould_flip)
    heights = np.flip(raw.values, flipped)
    stone = raw.copy(data=-heights if mould_invert else heights)
    unmeasured = ~np.isfinite(stone.values)
    scale_mm, step = np.nan, height_step(stone)
    if outlier_rule == "window":
        # The paper's windows are full. A spike beside a hole spreads into the points filled here,
        # so these are filled again from the good points once the outliers are known. (Of the
        # synthetic specimen's 131 050 filled points, 852 were more than 3 robust standard
        # deviations too high without this, 5 with it.)
        outlier, threshold = window_outliers(
            stone.copy(data=interpolate_holes(stone.values, unmeasured)),
            half_width=_WINDOW_HALF_WIDTH,
            share=outlier_fraction,
            measured=~unmeasured,
        )
    else:
        threshold = outlier_median_threshold
        outlier, scale_mm = median_outliers(
            stone, half_width=_MEDIAN_HALF_WIDTH, threshold=threshold, step=step
        )
    # ASSUME: Replacement of outliers. An outlier, like an unmeasured point, gets the value that is
    # interpolated linearly from the good points around it. Reason: On a slope, a mean over the
    # window would differ from the neighbouring points. Alternative: The mean of the window.
    clean = stone.copy(data=interpolate_holes(stone.values, unmeasured | outlier))
    level, plane = remove_plane(clean)
    scan = xr.Dataset(
        {
            "height": level,
            "filled": (level.dims, unmeasured),
            "outlier": (level.dims, outlier),
            "measured": stone.astype(np.float32),
        },
        attrs={
            **{name: raw.attrs[name] for name in raw.attrs if name not in _NOT_KEPT},
            "unmeasured": int(unmeasured.sum()),
            "filled": int(unmeasured.sum()),
            "outliers": int(outlier.sum()),
            "outlier_k": threshold,
            "outlier_scale_um": MM_TO_UM * scale_mm,
            "tilt_x_mrad": plane.tilt_x_mrad,
            "tilt_y_mrad": plane.tilt_y_mrad,
            "Sq_before_um": MM_TO_UM * float(np.nanstd(raw.values)),
            "Sq_after_um": MM_TO_UM * float(np.std(level.values)),
            "shortest_trusted_um": MM_TO_UM * shortest_trusted(level),
            "height_step_um": MM_TO_UM * step,
        },
    )
    return described(scan, _FIELDS)


def crop_of(row: Any) -> tuple[float, float] | None:
    """Centre (y, x), mm, of the piece to cut from the scans of a patch, a `row` of the table.

    Without a centre, the columns are empty or absent.
    """
    centre = [getattr(row, f"crop_{axis}_mm", np.nan) for axis in "yx"]
    absent = pd.isna(centre)
    if absent.all():
        return None
    y, x = centre
    if absent.any():
        problem = f"has crop_x_mm {x} and crop_y_mm {y}"
        raise InputError("patch table", problem, "Give both of them, or neither.")
    return float(y), float(x)


def mould_of(mould: Mapping, flip: str) -> Mapping:
    """The section ``scans.mould`` for a patch with a `flip` of x, y, none, or empty."""
    return mould if not flip else {**mould, "flip": None if flip == "none" else flip}


def preprocessing_table(scans: Mapping[tuple[str, str], Mapping]) -> pd.DataFrame:
    """The preparation of each scan, from the attributes of its dataset, by patch and epoch."""
    rows = [
        {"patch": patch, "epoch": epoch, **attrs}
        for (patch, epoch), attrs in scans.items()
    ]
    return pd.DataFrame(rows, columns=["patch", "epoch", *_DONE])


def check_unmeasured(surface: xr.DataArray, maximum_fraction: float) -> None:
    """Refuse a surface if more than a share (0 to 1) of it, or all of it, is NaN.

    Raises
    ------
    InputError
    """
    holes = np.isnan(surface.values)
    if holes.all() or holes.mean() > maximum_fraction:
        raise InputError(
            surface.attrs.get("file", "scan"),
            f"{100 * holes.mean():.3g} % of the points are unmeasured ({holes.sum()} of "
            f"{holes.size}), more than the limit of {100 * maximum_fraction:g} %",
            "Measure the patch again, leave it out of the patch table, or raise "
            "preprocessing.maximum_unmeasured in the config.",
        )


def interpolate_holes(heights: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """Fill each hole linearly from the points around it, or a corner from the nearest point.

    The points that touch a hole fence it. Any Delaunay triangulation of lattice points joins
    neighbours that are a grid step apart. Every triangle over a hole therefore has its corners on
    the fence of this hole, and only the fences are triangulated.
    """
    result = np.where(holes, np.nan, heights)
    around = scipy.ndimage.binary_dilation(holes, np.ones((3, 3)))
    fence = np.argwhere(around & ~holes)
    fence_heights = heights[tuple(fence.T)]
    # no points, or all on one line
    with contextlib.suppress(scipy.spatial.QhullError, ValueError):
        linear = scipy.interpolate.LinearNDInterpolator(fence, fence_heights)
        result[holes] = linear(np.argwhere(holes))
    rest = np.isnan(result)
    if rest.any():
        nearest = scipy.interpolate.NearestNDInterpolator(fence, fence_heights)
        result[rest] = nearest(np.argwhere(rest))
    return result


def prepare_patch(
    raw: xr.DataArray,
    *,
    crop: Sequence[float] | None,
    scans: Mapping,
    preprocessing: Mapping,
    epoch: str = "T0",
    flip: str = "",
) -> xr.Dataset:
    """Cut the patch out of a scan, undo the mould, replace outliers, fill and level (section 2.2).

    `raw` comes from `gstlib.io.scans.read_scan`, `crop` and `epoch` are as in `cut_patch`. `scans`
    and `preprocessing` are sections of the config. `flip` is the column of the patch table. For the
    result, see `prepare_scan`.
    """
    mould = mould_of(scans["mould"], flip)
    piece = cut_patch(
        raw, crop=crop, size_mm=scans["size_mm"], epoch=epoch, mould_flip=mould["flip"]
    )
    return prepare_scan(
        piece, mould_invert=mould["invert"], mould_flip=mould["flip"], **preprocessing
    )


def cut_patch(
    raw: xr.DataArray,
    *,
    crop: Sequence[float] | None,
    size_mm: float,
    epoch: str = "T0",
    mould_flip: str | None = None,
) -> xr.DataArray:
    """The patch of a measured scan; `mould_flip` is the axis along which it will be mirrored.

    Only T0 is cut, to the piece around `crop` (y, x), as in `gstlib.io.scans.cut_scan`. For another
    `epoch`, the stone was placed under the instrument again, so the middle of its scan is another
    point of the stone. This scan stays whole, and its coordinates are relative to the piece that
    `crop` defines.
    """
    if epoch == "T0":
        return cut_scan(raw, crop, size_mm)
    whole = whole_scan(raw, size_mm)
    for axis, middle, step in zip("yx", crop or (0, 0), spacing_of(raw), strict=True):
        beyond = (raw.sizes[axis] * step - size_mm) / 2
        if crop or beyond > 0.01 * size_mm:
            start = beyond + (-middle if axis == mould_flip else middle)
            moved = whole[axis].copy(data=whole[axis].values - start)
            whole = whole.assign_coords({axis: moved})
    return whole
