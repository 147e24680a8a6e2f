"""The use-face of a stone on a grid, and the active tool pressed on it.

The *face* is the square and the stone around it. The paper's square is cut out of it and pressed
alone (`gstlib.macroscale.equilibrium`).
"""

import logging
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import FaultError, refuse
from gstlib.macroscale.active_tool import (
    FLAT,
    ActiveTool,
    RoundedTool,
    face_in_pose,
    grid_counterface,
    rounded_counterface,
)
from gstlib.preprocess.mesh import elements_around, grid_mesh
from gstlib.surfaces.footprints import PatchPosition, square_of
from gstlib.surfaces.frames import find_frame, frame_variables
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh

__all__ = ["grid_macroscale", "largest_face", "thin_stone", "without_curvature"]

_log = logging.getLogger(__name__)

# Largest share of the face that may have no stone.
_MOST_ABSENT = 0.5
# ASSUME: Thinnest tool. A ground stone tool is at least 1 mm thick. Reason: Points over thinner
# stone lie on an edge or a speck of the mesh.
_THINNEST_MM = 1.0


def grid_macroscale(
    mesh: "trimesh.Trimesh",
    *,
    points_mm: Sequence[Sequence[float]],
    size_mm: float,
    grid: int,
    face_mm: float | None = None,
    active_tool: ActiveTool | RoundedTool = FLAT,
    interpolation: str = "best",
    source: str | Path = "mesh",
) -> tuple[xr.Dataset, xr.DataArray | None]:
    """Heights of the use-face over the square and around it, and of the active tool.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The passive tool, mm.
    points_mm : (3, 3) array_like
        The square's corner and two points, as in `gstlib.surfaces.frames.frame_from_points`.
    size_mm, grid
        Side of the square, and elements along it.
    face_mm : float, optional
        Side of the face, with the square in its middle. It is rounded to whole elements. The
        default is the square alone.
    active_tool : ActiveTool or RoundedTool
        The active tool. The default is flat.
    interpolation : str
        As in `gstlib.preprocess.mesh.grid_mesh`.
    source : path
        The mesh's file, for messages.

    Returns
    -------
    face : xarray.Dataset
        The dataset of `gstlib.preprocess.mesh.grid_mesh`, with ``height`` minus the plane of the
        square. It also contains the frame (see `gstlib.surfaces.frames.stored_frame`), the active
        tool ``counterface`` (y, x), mm (0 for a flat), and the side ``size_mm`` of the square.
    counterface : (y, x) xarray.DataArray or None
        The mesh of an active tool, as far as it moves, from
        `gstlib.macroscale.active_tool.grid_counterface`.

    Raises
    ------
    InputError
        Most of the face has no stone, or as in `grid_mesh` and `grid_counterface`.

    Examples
    --------
    A square of 2 mm in the middle of the upper side of a block:

    >>> import gstlib, trimesh
    >>> block = trimesh.creation.box((4, 4, 3))
    >>> for _ in range(4):
    ...     block = block.subdivide()
    >>> points_mm = [[1, 1, 1.5], [-1, 1, 1.5], [1, -1, 1.5]]
    >>> face, _ = gstlib.grid_macroscale(block, points_mm=points_mm, size_mm=2.0, grid=8)
    >>> face.height.shape, face.height.attrs["thickness_mm"]
    ((8, 8), 3.0)
    """
    frame = find_frame(points_mm, mesh, size_mm=size_mm, source=str(source))
    gridded = grid_mesh(
        mesh,
        frame,
        size_mm=size_mm,
        grid=grid,
        around=elements_around(size_mm, grid, face_mm),
        interpolation=interpolation,
        source=str(source),
    )
    height = gridded.height
    _check_extent(height, face_mm or size_mm, source)
    if isinstance(active_tool, ActiveTool):
        counterface = grid_counterface(
            active_tool, height, frame, size_mm=size_mm, interpolation=interpolation
        )
        over = face_in_pose(
            counterface, height, PatchPosition(0.0, 0.0), size_mm=size_mm
        )
    else:
        counterface = None
        middle = size_mm / 2, size_mm / 2
        over = rounded_counterface(
            height, active_tool.radius_mm, middle, active_tool.angle_deg
        )
    over.attrs = {"units": "mm", "long_name": "height of the counterface, 0 for a flat"}
    _, plane = remove_plane(square_of(height, size_mm))
    face = {"height": height.copy(data=height.values - plane.heights(height))}
    face |= {"counterface": over} | frame_variables(frame)
    face["size_mm"] = (), size_mm, {"units": "mm", "long_name": "side of the square"}
    return gridded.assign(face), counterface


def without_curvature(face: xr.Dataset) -> xr.Dataset:
    """The face without the curvature of its square, as in its least-squares quadric.

    Use may have made it: a facet that is ground flat or hollow fits the tool that ground it.

    Examples
    --------
    >>> from gstlib.surfaces.grid import make_surface
    >>> rough = make_surface(np.random.default_rng(1).normal(size=(9, 9)), 1.0)
    >>> bend = rounded_counterface(rough, (-90.0, 300.0), (3.0, 4.0), 20.0)
    >>> straight, bent = (
    ...     without_curvature(xr.Dataset({"height": height, "size_mm": 5.0})).height
    ...     for height in (rough, rough + bend)
    ... )
    >>> np.allclose(remove_plane(bent - straight)[0], 0)
    True
    """
    height = face.height
    middle = float(face.size_mm) / 2

    def powers(surface: xr.DataArray) -> np.ndarray:
        y, x = np.meshgrid(surface.y - middle, surface.x - middle, indexing="ij")
        return np.stack([y * y, y * x, x * x, y, x, np.ones_like(x)], axis=-1)

    square = square_of(height, float(face.size_mm))
    there = np.isfinite(square.values)
    factors, *_ = np.linalg.lstsq(
        powers(square)[there], square.values[there], rcond=None
    )
    return face.assign(height=height - powers(height)[..., :3] @ factors[:3])


def _check_extent(height: xr.DataArray, face_mm: float, source: str | Path) -> None:
    """Refuse a face that is mostly beyond the stone, and warn if it is large for the stone."""
    absent = float(np.isnan(height.values).mean())
    if absent > _MOST_ABSENT:
        problem = (
            f"{100 * absent:.0f} % of the face of {face_mm:g} mm lies beyond the stone"
        )
        refuse(FaultError("face", source, problem, "Make macroscale.face_mm smaller."))
    if absent:
        _log.warning(
            "%s: %.2g %% of the face of %g mm lies beyond the mesh, which ends or turns away "
            "there. If the stone itself continues, make macroscale.face_mm smaller",
            source,
            100 * absent,
            face_mm,
        )
    thickness = height.attrs["thickness_mm"]
    side = largest_face(thickness)
    if thickness >= _THINNEST_MM and side < face_mm:
        _log.warning(
            "%s: the stone is %g mm thick under the square, less than the %g mm of its face. It "
            "bends, but the half-spaces of the model do not. Set macroscale.face_mm to %g, or use "
            "pressures with care if that is less than the square",
            source,
            side,
            face_mm,
            side,
        )


def largest_face(thickness_mm: float) -> float:
    """The largest side (mm) of a face that does not exceed the thickness of the stone.

    It is the thickness under the square, rounded down to tenths of a millimetre.

    Examples
    --------
    >>> largest_face(14.67), largest_face(8.0), largest_face(math.nan)
    (14.6, 8.0, inf)
    """
    return (
        math.floor(10 * thickness_mm) / 10 if math.isfinite(thickness_mm) else math.inf
    )


def thin_stone(height: xr.DataArray, *, source: str | Path) -> Iterator[FaultError]:
    """A fault, if the stone is so thin under the square that the points must be wrong."""
    if (thickness := height.attrs["thickness_mm"]) < _THINNEST_MM:
        yield FaultError(
            "thickness",
            source,
            f"the stone is {thickness:.3g} mm thick under the square, too thin for a tool",
            "Pick square.points_mm where the stone was used, facing outwards, and check mesh_unit.",
        )
