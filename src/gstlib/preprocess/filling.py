"""Heights for the points of a scan that were not measured."""

import numpy as np
import xarray as xr
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.ndimage import binary_dilation
from scipy.spatial import QhullError

from gstlib.errors import InputError

__all__ = ["check_unmeasured", "fill_unmeasured", "interpolate_holes"]


def fill_unmeasured(
    surface: xr.DataArray, *, maximum_share: float
) -> tuple[xr.DataArray, xr.DataArray]:
    """Fill the unmeasured points from those around them.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, NaN where unmeasured.
    maximum_share : float
        Largest share (0 to 1) of unmeasured points that is accepted.

    Returns
    -------
    surface : (ny, nx) xarray.DataArray
        Heights, mm, without NaN.
    filled : (ny, nx) xarray.DataArray of bool
        What was filled.

    Raises
    ------
    InputError
        More than `maximum_share` of the points, or all of them, are unmeasured.
    """
    check_unmeasured(surface, maximum_share)
    holes = ~np.isfinite(surface.values)
    filled = xr.DataArray(holes, coords=surface.coords, dims=surface.dims, name="filled")
    return surface.copy(data=interpolate_holes(surface.values, holes)), filled


def check_unmeasured(surface: xr.DataArray, maximum_share: float) -> None:
    """Refuse a surface of which more than a share (0 to 1), or all, is NaN: raises InputError."""
    holes = ~np.isfinite(surface.values)
    source = surface.attrs.get("file", "scan")
    if holes.all():
        raise InputError(source, "not one point is measured", "Measure the patch again.")
    if holes.mean() > maximum_share:
        raise InputError(
            source,
            f"{100 * holes.mean():.3g} % of the points are unmeasured ({holes.sum()} of "
            f"{holes.size}), more than the limit of {100 * maximum_share:g} %",
            "Measure the patch again, leave it out of the patch table, or raise "
            "preprocessing.maximum_unmeasured in the config.",
        )


def interpolate_holes(heights: np.ndarray, holes: np.ndarray) -> np.ndarray:
    """Heights with those in `holes` replaced, linearly from the points around each hole.

    The points that touch a hole fence it: neighbours a grid step apart are joined in any Delaunay
    triangulation of lattice points, so that every triangle over a hole has its corners on that
    hole's own fence, and the fences are all that has to be triangulated. In a corner of the map,
    where no triangle reaches, the nearest point is taken.

    Parameters
    ----------
    heights : (ny, nx) ndarray
        mm; what stands in the holes is not looked at.
    holes : (ny, nx) ndarray of bool
        At least one element is not a hole.
    """
    if not holes.any():
        return heights.copy()
    fence = np.argwhere(binary_dilation(holes, np.ones((3, 3))) & ~holes)
    wanted = np.argwhere(holes)
    known = heights[tuple(fence.T)]
    try:
        values = LinearNDInterpolator(fence, known)(wanted)
    except QhullError:  # all on one line: no triangle
        values = np.full(len(wanted), np.nan)
    rest = np.isnan(values)
    if rest.any():
        values[rest] = NearestNDInterpolator(fence, known)(wanted[rest])
    result = heights.copy()
    result[holes] = values
    return result
