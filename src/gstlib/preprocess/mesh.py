"""From a stone's mesh to the heights of its use-face on a regular grid.

The use-face is separated from the rest of the stone. The cloud of its vertices is cropped larger
than the grid and interpolated in the square's plane. The grid covers the square and, if requested,
the stone around it.
"""

import logging
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.errors import FaultError, InputError, refuse
from gstlib.preprocess.interpolation import compare, interpolate
from gstlib.preprocess.use_face import Layout, find_use_face
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import described, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["elements_around", "grid_mesh", "gridding_table"]

_log = logging.getLogger(__name__)

# ASSUME: Pin-holes of the mesh. Holes of the mesh up to 1 % of the square are pin-holes of the
# scanner. Reason: The interpolation bridges them, as the paper's interpolation would.
_BRIDGED_FRACTION = 1e-2
# Fewest vertices in the square: from fewer, errors between them cannot be estimated.
_FEWEST = 30
# Units and meanings of the errors on left-out vertices.
_FIELDS = {
    "vertex_y": ("mm", "y of a left-out vertex"),
    "vertex_x": ("mm", "x of a left-out vertex"),
    "left_out_error": ("mm", "height minus its prediction"),
    "left_out_rms": ("mm", "r.m.s. error on left-out vertices"),
}


def elements_around(size_mm: float, grid: int, face_mm: float | None) -> int:
    """Elements of a face on every side of its square; 0 if the face is not larger."""
    return 0 if face_mm is None else max(0, round((face_mm / size_mm - 1) * grid / 2))


def grid_mesh(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    grid: int,
    around: int = 0,
    interpolation: str = "best",
    source: str = "mesh",
) -> xr.Dataset:
    """Heights of the use-face over the analysed square and around it, and their errors.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm, with equal vertices merged and faces pointing outwards, as from
        `gstlib.io.meshes.read_mesh`.
    frame : Frame
        The square's frame. Its origin need not touch the surface.
    size_mm : float
        Side of the square.
    grid : int
        Elements along it.
    around : int
        Elements of the face on every side of the square.
    interpolation : {"linear", "clough-tocher", "cubic", "best"}
        Linear over the Delaunay triangulation, smooth over it (Clough-Tocher), or a cubic radial
        basis of the 50 nearest vertices. "best" has the smallest error on left-out vertices.
    source : str
        Name of the mesh's file, for messages.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x), mm, along the normal above the frame's origin, at the element centres of
        the face. The square extends from 0 to `size_mm`. It is NaN where stone is missing.
        Attributes: ``mesh_points`` (number interpolated), ``mesh_edge_mm`` (mean edge length in the
        crop), ``interpolation``, and ``thickness_mm`` (a low percentile under the square, NaN for a
        mesh without an underside). ``vertex_y, vertex_x`` (vertex), mm, of the vertices left out,
        and ``left_out_error`` (vertex), mm: height minus its prediction from the others.
        ``left_out_rms`` (candidate), mm: the r.m.s. of these errors for each interpolation tried.

    Raises
    ------
    InputError
        The square misses the stone or sticks out of it, or contains fewer than 30 vertices. The
        mesh folds over within the square, or its faces point into the stone.
    """
    layout = Layout(size_mm, grid, around)
    use_face = find_use_face(mesh, frame, layout, source=source)
    cloud, edge = use_face.cloud, use_face.edge
    _check_vertices(cloud, size_mm, source)
    heights = interpolate("linear", cloud, layout.along, edge)
    _check_holes(heights, use_face.bare, layout, source)
    left_out = compare(interpolation, cloud, layout.bounds)
    if left_out.chosen != "linear":  # the linear heights exist already
        heights = interpolate(left_out.chosen, cloud, layout.along, edge)
    surface = make_surface(
        np.where(use_face.ends, np.nan, heights),
        layout.spacing,
        long_name="height of the use-face",
        mesh_points=len(cloud),
        mesh_edge_mm=edge,
        interpolation=left_out.chosen,
        thickness_mm=use_face.thickness,
    )
    centres = {axis: surface[axis].copy(data=layout.along) for axis in surface.dims}
    x, y, _ = left_out.vertices.T
    errors = xr.Dataset(
        {
            "vertex_y": ("vertex", y),
            "vertex_x": ("vertex", x),
            "left_out_error": ("vertex", left_out.errors),
            "left_out_rms": ("candidate", left_out.rms),
        },
        coords={"candidate": list(left_out.tried)},
    )
    return described(errors, _FIELDS).assign(height=surface.assign_coords(centres))


def _check_vertices(cloud: np.ndarray, size_mm: float, source: str) -> None:
    """Refuse a mesh that is too coarse to estimate its interpolation error."""
    places = cloud[:, :2]
    count = int(((places >= 0) & (places <= size_mm)).all(axis=1).sum())
    if count < _FEWEST:
        raise InputError(
            source,
            f"the mesh has {count} vertices in the square of {size_mm:g} mm, and at least "
            f"{_FEWEST} are needed",
            "Give a finer mesh, make square.size_mm larger, or check inputs.mesh_unit in the "
            "config.",
        )


def _check_holes(
    heights: np.ndarray, bare: np.ndarray, layout: Layout, source: str
) -> None:
    """Refuse a square without stone, by its interpolated heights and by rays that miss."""
    unknown = np.isnan(heights) & layout.in_square
    if unknown.any() or bare.sum() > _BRIDGED_FRACTION * layout.grid**2:
        problem = (
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{layout.share_of_square(unknown | bare)}"
        )
        remedy = (
            "Move square.points_mm in the config, make square.size_mm smaller, check "
            "inputs.mesh_unit, or repair the mesh (holes, and faces turned inside out)."
        )
        if unknown.any():
            raise InputError(source, problem, remedy)
        refuse(FaultError("holes", source, problem, remedy))
    if bare.any():
        _log.warning(
            "holes of the mesh were bridged on %s", layout.share_of_square(bare)
        )


def gridding_table(square: xr.Dataset) -> pd.DataFrame:
    """How well each interpolation predicts vertices left out of the mesh, and which was chosen.

    The result has ``interpolation, left_out_rms_um, chosen``.
    """
    return pd.DataFrame(
        {
            "interpolation": square.candidate.values,
            "left_out_rms_um": 1e3 * square.left_out_rms.values,
            "chosen": square.candidate.values == square.height.attrs["interpolation"],
        }
    )
