"""How far the two ways to grid a mesh differ.

Both are right at the mesh's vertices. Between them they differ where the Delaunay triangulation of
the vertices is not the mesh's own. A difference as large as the roughness says that the heights are
those of a triangulation, not of the stone.
"""

import logging

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.preprocess.leveling import remove_plane

__all__ = ["compare_gridding", "gridding_attributes"]

_log = logging.getLogger(__name__)

_MM_TO_UM = 1e3
# A difference (r.m.s.) beyond this share of the roughness Sq is worth a warning.
_LARGE = 0.1


def compare_gridding(gridded: xr.Dataset) -> tuple[xr.DataArray, pd.DataFrame]:
    """The difference of the heights that `grid_both_ways` gives.

    Parameters
    ----------
    gridded : xarray.Dataset
        ``height`` and ``pierced`` (y, x), mm.

    Returns
    -------
    difference : (ny, nx) xarray.DataArray
        ``pierced`` − ``height``, mm, NaN where the mesh has a hole.
    table : pandas.DataFrame
        A row for each method: the mesh's points and the grid's elements used, roughness Sq and
        highest summit above the least-squares plane of ``height``, and, against ``height``, the
        r.m.s. and the largest difference (absolute, and where) and the correlation.
    """
    level, plane = remove_plane(gridded.height)
    other = gridded.pierced - plane.heights(gridded.height)
    difference = (gridded.pierced - gridded.height).assign_attrs(
        units="mm", long_name="height of the mesh's faces less the interpolated one"
    )
    table = pd.DataFrame(
        [
            _row("scattered interpolation", level, level, gridded.height.attrs),
            _row("faces pierced", other, level, gridded.pierced.attrs),
        ]
    )
    rms, roughness = table.rms_difference_um[1], table.Sq_um[0]
    if rms > _LARGE * roughness:
        _log.warning(
            "interpolation and faces differ by %.3g µm r.m.s., Sq is %.3g µm: the mesh is coarse "
            "for the grid, or its faces are slivers",
            rms,
            roughness,
        )
    return difference, table


def _row(method: str, heights: xr.DataArray, reference: xr.DataArray, attrs) -> dict[str, object]:
    known = np.isfinite(heights.values)
    values, others = heights.values[known], reference.values[known]
    difference = np.abs(heights - reference)
    worst = np.unravel_index(np.nanargmax(difference.values), difference.shape)
    same = heights is reference
    return {
        "method": method,
        "mesh_points": int(attrs["mesh_points"]),
        "elements": int(known.sum()),
        "Sq_um": float(np.sqrt(np.mean(values**2))) * _MM_TO_UM,
        "highest_um": float(values.max()) * _MM_TO_UM,
        "rms_difference_um": float(np.sqrt(np.mean((values - others) ** 2))) * _MM_TO_UM,
        "largest_difference_um": float(difference.values[worst]) * _MM_TO_UM,
        "x_mm": np.nan if same else float(heights.x[worst[1]]),
        "y_mm": np.nan if same else float(heights.y[worst[0]]),
        "correlation": _correlation(values, others),
    }


def _correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Pearson's correlation, NaN where a surface is flat."""
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return np.nan
    return float(np.corrcoef(first, second)[0, 1])


def gridding_attributes(table: pd.DataFrame) -> dict[str, float]:
    """The second row of `compare_gridding`, as attributes of the surface's file."""
    first, second = table.iloc[0], table.iloc[1]
    return {
        "gridding_rms_difference_um": float(second.rms_difference_um),
        "gridding_largest_difference_um": float(second.largest_difference_um),
        "gridding_largest_x_mm": float(second.x_mm),
        "gridding_largest_y_mm": float(second.y_mm),
        "gridding_correlation": float(second.correlation),
        "gridding_bridged_elements": int(first.elements - second.elements),
    }
