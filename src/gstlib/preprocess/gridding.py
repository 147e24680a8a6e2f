"""From a stone's mesh to the heights of its use-face on a regular grid.

As in the paper: the cloud of vertices is cropped larger than the square, interpolated linearly over
its Delaunay triangulation in the square's plane (what MATLAB's scatteredInterpolant does), and the
square is cut out after. Before it, the use-face is told from the rest of the stone, since a closed
mesh has two sheets over each x, y. The faces themselves, pierced along the normal, give the heights
a second time, without any interpolation: a check of the first.
"""

import logging
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.sheet import SAME_VERTEX, crop_mesh, find_use_face, pierce
from gstlib.surface import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Frame", "grid_both_ways", "grid_mesh"]

_log = logging.getLogger(__name__)

# ASSUME: holes of the mesh up to this share of the square are bridged by the interpolation, as the
# paper's would; they are pin-holes of the scanner.
_BRIDGED_SHARE = 1e-2
# ASSUME: overhangs up to this share of the square are specks of the scanner and let pass.
_FOLDED_SHARE = 1e-3


def grid_mesh(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    shape: tuple[int, int],
    margin_mm: float,
    source: str = "mesh",
) -> xr.DataArray:
    """Heights of the use-face over the analysed square, interpolated as in the paper.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm; closed, or an open sheet whose faces look out of the stone.
    frame : Frame
        The square's frame. Its origin need not touch the surface, but if several sheets look
        outwards over the square, the one nearest to its plane is the use-face.
    size_mm : float
        Side of the square.
    shape : (ny, nx)
        Elements of the grid.
    margin_mm : float
        How much larger than the square the cloud is cropped on every side.
    source : str
        Name of the mesh's file, for messages.

    Returns
    -------
    (ny, nx) xarray.DataArray
        Heights along the normal, mm, above the frame's origin, at the element centres of
        [0, size]²; attributes ``mesh_points`` (number interpolated) and ``mesh_edge_mm`` (mean edge
        length in the crop).

    Raises
    ------
    InputError
        The square misses the stone or sticks out of it, the mesh folds over within the square, or
        its faces look into the stone.
    """
    return grid_both_ways(
        mesh, frame, size_mm=size_mm, shape=shape, margin_mm=margin_mm, source=source
    ).height


def grid_both_ways(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    shape: tuple[int, int],
    margin_mm: float,
    source: str = "mesh",
) -> xr.Dataset:
    """Heights of the use-face, interpolated and pierced.

    Parameters and errors are those of `grid_mesh`.

    Returns
    -------
    xarray.Dataset
        ``height``, as `grid_mesh` gives it, and ``pierced``: the same heights (mm) where the normal
        through an element's centre meets the mesh's own faces, NaN where there is none (a hole);
        its attribute ``mesh_points`` is the number of those faces' corners.
    """
    points = frame.to_frame(mesh.vertices)
    crop = crop_mesh(mesh, points, size_mm=size_mm, margin_mm=margin_mm, source=source)
    ny, nx = shape
    y, x = np.meshgrid(
        axis_coordinates(ny, size_mm / ny), axis_coordinates(nx, size_mm / nx), indexing="ij"
    )
    hits = pierce(crop, x.ravel(), y.ravel())
    body, up = find_use_face(crop, hits, source)
    if not up:
        raise InputError(
            source,
            "the mesh's faces over the square look against the frame's normal",
            "Turn square.frame.normal in the config if it points into the stone; else turn the "
            "mesh's faces.",
        )
    kept = crop.up & body
    hits = hits.keep(kept)
    pierced = hits.highest(x.size)
    _check_single_valued(pierced - hits.lowest(x.size), x.ravel(), y.ravel(), source)
    pierced = np.where(np.isfinite(pierced), pierced, np.nan).reshape(shape)
    used = np.unique(crop.faces[kept])
    heights = _interpolate(crop.points[used], x, y, source)
    _check_coverage(np.isnan(heights), np.isnan(pierced), x, y, source)
    spacing = (size_mm / ny, size_mm / nx)
    return xr.Dataset(
        {
            "height": make_surface(
                heights,
                spacing,
                long_name="height of the use-face",
                mesh_points=len(used),
                mesh_edge_mm=_mean_edge(crop.points, crop.faces[kept]),
            ),
            "pierced": make_surface(
                pierced,
                spacing,
                long_name="height of the use-face's faces",
                mesh_points=len(np.unique(crop.faces[hits.face])),
            ),
        }
    )


def _check_single_valued(step: np.ndarray, x, y, source) -> None:
    """Refuse a use-face that folds over: several heights, `step` apart, at one element."""
    folded = step > SAME_VERTEX
    if folded.sum() > _FOLDED_SHARE * x.size:
        raise InputError(
            source,
            f"the mesh folds over within the square: {_describe(folded, x, y)} has two heights, "
            f"up to {step.max():.3g} mm apart",
            "Turn square.frame so that it looks at the use-face squarely, move it, or repair the "
            "mesh.",
        )
    if folded.any():
        _log.warning("the mesh folds over in specks: %s", _describe(folded, x, y))


def _interpolate(points: np.ndarray, x: np.ndarray, y: np.ndarray, source: str) -> np.ndarray:
    """Linear interpolation of scattered heights at (x, y), NaN outside their hull."""
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    try:
        return LinearNDInterpolator(points[:, :2], points[:, 2])(x, y)
    except (QhullError, ValueError) as error:
        raise InputError(
            source,
            f"its {len(points)} vertices over the square cannot be triangulated",
            "Repair the mesh, or move square.frame.",
        ) from error


def _check_coverage(outside, bare, x, y, source) -> None:
    """Refuse a square that sticks out of the mesh (NaN) or lies over a large hole of it."""
    if outside.any() or bare.mean() > _BRIDGED_SHARE:
        missing = outside | bare
        raise InputError(
            source,
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{_describe(missing, x, y)}",
            "Move square.frame in the config, make square.size_mm smaller, or repair the mesh "
            "(holes, and faces turned inside out).",
        )
    if bare.any():
        _log.warning("holes of the mesh were bridged: %s", _describe(bare, x, y))


def _describe(mask: np.ndarray, x: np.ndarray, y: np.ndarray) -> str:
    """How much of the square a mask is, and where."""
    return (
        f"{100 * mask.mean():.3g} % of the square (x {x[mask].min():.3g} to {x[mask].max():.3g}, "
        f"y {y[mask].min():.3g} to {y[mask].max():.3g} mm)"
    )


def _mean_edge(points: np.ndarray, faces: np.ndarray) -> float:
    """Mean length (mm) of the faces' edges."""
    corners = points[faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
