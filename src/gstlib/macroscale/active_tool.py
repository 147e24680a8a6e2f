"""The active tool's own face over the square: posed on the passive tool, and moved on it.

A contact of half-spaces depends only on the gap between two faces, so the heights of both add
(Bemporad & Paggi, Int. J. Solids Struct. 69-70 (2015) 465). A contact needs only the heights of the
active tool over the square, positive towards the passive one.

A pose is the position of the active tool on the passive one. In either form it defines a frame of
the active mesh: the frame of the square as seen on the active face. The active face is turned over
about the square's y axis, so that its x runs against the other x.
"""

# ASSUME: Paraboloid as the active tool. An active tool without a mesh is a paraboloid of one or two
# radii, or flat. Its summit may be anywhere. Reason: Moving the summit is equivalent to tilting the
# stone, and in equilibrium the stone finds its own tilt. Alternative: A mesh of the active tool.

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from gstlib.errors import ConfigError, FaultError, InputError, refuse
from gstlib.io.meshes import read_mesh
from gstlib.preprocess.mesh import grid_mesh
from gstlib.surfaces.footprints import PatchPosition, rotated, spline_of, square_of
from gstlib.surfaces.frames import Frame, find_frame
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "FLAT",
    "ActiveTool",
    "RoundedTool",
    "as_round_as",
    "face_in_pose",
    "grid_counterface",
    "pose_frame",
    "posed_mesh",
    "rounded_counterface",
    "stated_tool",
]

_KEY = "counterface.pose"
# A pose moves the stone and neither stretches nor mirrors it. Typed digits deviate by less.
_RIGID = 1e-3


class RoundedTool(NamedTuple):
    """A rounded active tool, with its summit over the middle.

    Attributes
    ----------
    radius_mm : float, (float, float) or None
        Its radius, or the radii along and across an axis; negative if it is hollow. None for a
        flat.
    angle_deg : float
        Direction of this axis, from x towards y.
    """

    radius_mm: float | Sequence[float] | None
    angle_deg: float = 0.0


FLAT = RoundedTool(None)


class ActiveTool(NamedTuple):
    """The mesh of an active tool, and its pose on the passive one.

    Attributes
    ----------
    mesh : trimesh.Trimesh
        mm.
    pose : mapping
        Either ``points_mm``, three points of the square on the active mesh (see
        `gstlib.surfaces.frames.frame_from_points`), or ``matrix``, which maps points of the active
        mesh to the passive mesh (4 × 4, mm).
    reach_mm : float
        Margin of its face around the passive face.
    source : str
        Name of the mesh's file, for messages.
    """

    mesh: "trimesh.Trimesh"
    pose: Mapping
    reach_mm: float
    source: str

    @classmethod
    def read(
        cls, mesh: str | Path, *, mesh_unit: str, pose: Mapping, reach_mm: float
    ) -> "ActiveTool":
        """The stone of a mesh's file, as in `gstlib.io.meshes.read_mesh`."""
        return cls(read_mesh(mesh, unit=mesh_unit), pose, reach_mm, str(mesh))


def stated_tool(
    mesh: Mapping[str, Any] | None,
    rounded: tuple[float | Sequence[float] | None, float],
) -> ActiveTool | RoundedTool:
    """The active tool of a `mesh`, as in `ActiveTool.read`, or else a `rounded` one."""
    return RoundedTool(*rounded) if mesh is None else ActiveTool.read(**mesh)


def pose_frame(stone: ActiveTool, frame: Frame, *, size_mm: float) -> Frame:
    """The frame, on the active mesh, of the square that is turned over onto the passive one.

    `frame` is the frame of the square, of side `size_mm`, on the passive tool.

    Raises
    ------
    ConfigError
        The pose is invalid.
    """
    if "points_mm" in stone.pose:
        points = stone.pose["points_mm"]
        try:
            return find_frame(points, stone.mesh, size_mm=size_mm, source=stone.source)
        except ConfigError as error:  # it names the passive tool's points
            raise error.about(f"{_KEY}.points_mm", error.problem) from error
    matrix = np.asarray(stone.pose["matrix"], float)
    turn, shift = matrix[:3, :3], matrix[:3, 3]
    is_unit = np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID)
    is_rotation = is_unit and np.linalg.det(turn) > 0
    if not (is_rotation and np.allclose(matrix[3], [0, 0, 0, 1])):
        raise ConfigError(
            f"{_KEY}.matrix",
            f"{matrix.tolist()} does not move a stone: it stretches or mirrors it",
            "Give a rotation and a shift in mm, with the last row 0, 0, 0, 1.",
        )
    x_axis, _, normal = frame.axes
    corner = np.array(frame.origin) + size_mm * x_axis
    axes = ((corner - shift) @ turn, -x_axis @ turn, -normal @ turn)
    return Frame(*(axis.tolist() for axis in axes))


def posed_mesh(stone: ActiveTool, frame: Frame, *, size_mm: float) -> "trimesh.Trimesh":
    """The active tool (mm) in its pose on the passive one, for display. Its tilt is not included.

    `frame` is the frame of the square, of side `size_mm`, on the passive tool.
    """
    own = pose_frame(stone, frame, size_mm=size_mm)
    turned = own.to_frame(stone.mesh.vertices) * (-1, 1, -1) + (size_mm, 0, 0)
    moved = stone.mesh.copy()
    moved.vertices = turned @ frame.axes + np.array(frame.origin)
    return moved


def rounded_counterface(
    height: xr.DataArray,
    radius_mm: float | Sequence[float] | None,
    middle: tuple[float, float],
    angle_deg: float = 0.0,
) -> xr.DataArray:
    """The face of a rounded active tool over a surface (y, x), mm; 0 for a flat.

    `radius_mm` and `angle_deg` are as in `RoundedTool`, and its summit is at `middle` (y, x), mm.

    Raises
    ------
    InputError
        A radius is 0 or NaN, or there are more than two.

    Examples
    --------
    A handstone with a radius of 200 mm along x and of 50 mm across it, 1 mm from its summit:

    >>> import gstlib
    >>> flat = gstlib.make_surface(np.zeros((3, 3)), 1.0)
    >>> face = gstlib.rounded_counterface(flat, (200.0, 50.0), middle=(1.5, 1.5))
    >>> [round(1e3 * float(face.sel(y=y, x=x)), 1) for y, x in ((1.5, 0.5), (0.5, 1.5))]  # um
    [-2.5, -10.0]
    """
    y, x = (height[axis].values - at for axis, at in zip("yx", middle, strict=True))
    radii = np.ravel(np.inf if radius_mm is None else radius_mm)
    if radii.size not in (1, 2) or not abs(radii).min() > 0:
        remedy = "Give one radius or two, in mm and not 0, or None for a flat."
        raise InputError("radius_mm", f"is {radius_mm}", remedy)
    if radii.size == 2:
        across, along = rotated(y[:, None], x, -angle_deg)
        over = -0.5 * (along**2 / radii[0] + across**2 / radii[1])
    else:
        over = -0.5 * (1 / radii[0]) * (y[:, None] ** 2 + x**2)
    return height.copy(data=over).assign_attrs(long_name="height of the counterface")


def as_round_as(
    counterface: xr.DataArray, radius_mm: float, other_mm: float
) -> xr.DataArray:
    """The face of a rounded active tool of `radius_mm`, mm, with its radii in proportion.

    `other_mm` replaces the radius `radius_mm`, or the geometric mean of two radii.

    Examples
    --------
    >>> from gstlib.surfaces.grid import make_surface
    >>> flat = make_surface(np.zeros((3, 3)), 1.0)
    >>> face = rounded_counterface(flat, (80.0, 20.0), (1.0, 1.2), 30.0)
    >>> twice = rounded_counterface(flat, (160.0, 40.0), (1.0, 1.2), 30.0)
    >>> np.allclose(as_round_as(face, 40.0, 80.0), twice)
    True
    """
    return counterface.copy(data=counterface.values * (radius_mm / other_mm))


def grid_counterface(
    stone: ActiveTool,
    surface: xr.DataArray,
    frame: Frame,
    *,
    size_mm: float,
    interpolation: str,
) -> xr.DataArray:
    """Heights of the active tool's face over the passive one's, and as far as it moves.

    Parameters
    ----------
    stone : ActiveTool
    surface : (ny, nx) xarray.DataArray
        Heights of the passive tool over the square and the face around it, mm above `frame`.
    frame : Frame
        Frame of the square on the passive tool.
    size_mm : float
        Side of the square.
    interpolation : str
        As in `gstlib.preprocess.mesh.grid_mesh`.

    Returns
    -------
    (my, mx) xarray.DataArray
        Heights towards the passive tool, mm, in the square's coordinates, minus their plane over
        the square. They are NaN where stone is missing.

    Raises
    ------
    InputError, ConfigError
        The active tool misses the square or faces away from it. The gap or overlap of the stones
        exceeds their relief. See also `grid_mesh` and `pose_frame`.
    """
    dx = spacing_of(surface)[1]
    grid = round(size_mm / dx)
    own = pose_frame(stone, frame, size_mm=size_mm)
    try:
        gridded = grid_mesh(
            stone.mesh,
            own,
            size_mm=size_mm,
            grid=grid,
            around=(surface.sizes["x"] - grid) // 2 + math.ceil(stone.reach_mm / dx),
            interpolation=interpolation,
            source=stone.source,
        ).height
    except InputError as error:
        problem = f"the active tool in its pose: {error.problem}"
        remedy = f"Check {_KEY} and counterface.mesh_unit in the config."
        raise error.about(stone.source, problem, remedy) from error
    face = gridded.copy(data=gridded.values[:, ::-1])
    over = square_of(face, size_mm)
    below = square_of(surface, size_mm).values
    _, plane = remove_plane(over)
    gap = -float((below + over.values).max())
    relief = float(np.ptp(below) + np.ptp(over.values))
    if "points_mm" not in stone.pose and abs(gap) > relief:
        where = "in" if gap < 0 else "away from"
        problem = (
            f"the active tool in its pose is {abs(gap):.3g} mm {where} the passive one, more than "
            f"the {relief:.3g} mm between the summits and dales of both faces"
        )
        remedy = f"Check {_KEY}: the two must touch."
        refuse(FaultError("apart", stone.source, problem, remedy))
    level = face.copy(data=face.values - plane.heights(face))
    return level.assign_attrs(long_name="height of the counterface")


def face_in_pose(
    face: xr.DataArray, height: xr.DataArray, pose: PatchPosition, *, size_mm: float
) -> xr.DataArray:
    """The active face over the passive one after the stone was moved.

    `face` is from `grid_counterface`, `height` (ny, nx) gives the grid, and `size_mm` is the side
    of the square. The stone turns about the middle of the square, from x towards y, and is then
    shifted by ``y_mm, x_mm`` of `pose`. The result is NaN where the active tool is missing.

    Raises
    ------
    InputError
        The face does not reach so far.
    """
    middle = size_mm / 2
    moved = PatchPosition(middle + pose.y_mm, middle + pose.x_mm, pose.rotation_deg)
    y, x = np.meshgrid(height.y, height.x, indexing="ij")
    at = [middle + along for along in moved.seen(y, x)]
    for where, axis in zip(at, "yx", strict=True):
        half = spacing_of(height)[0] / 2
        low, high = face[axis].values[[0, -1]] + [-half, half]
        if where.min() < low or where.max() > high:
            raise InputError(
                "gesture",
                f"a pose moves the active tool by ({pose.x_mm:g}, {pose.y_mm:g}) mm and "
                f"{pose.rotation_deg:g}°, beyond the known part of its face",
                "Move it less.",
            )

    def over(field: xr.DataArray) -> np.ndarray:
        spline = spline_of(field)
        if pose.rotation_deg == 0:
            return spline(at[0][:, 0], at[1][0])
        return spline.ev(*at)

    values = over(face)
    absent = np.isnan(face.values)
    if absent.any():
        values[over(face.copy(data=absent.astype(float))) > 0.5] = np.nan
    return height.copy(data=values).assign_attrs(face.attrs)
