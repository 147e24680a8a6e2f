"""The active stone's own face over the square: posed on the passive stone, and moved on it.

Only the gap between two faces enters a contact of half-spaces, so that the heights of both add
(Bemporad & Paggi, Int. J. Solids Struct. 69-70 (2015) 465). All that a contact needs of the second
stone is its heights over the square, positive towards the first.

A pose says where the active stone stands on the passive one. Whichever way it is given, it comes
down to a frame of the active mesh: that of the square as seen on the active face, which is laid on
the passive one turned over about the square's y axis, so that its x runs against the other's.
"""

# ASSUME: a stone that is held in a hand tilts until its face follows the other's: the plane of the
# active face over the square is taken out, as that of the passive face is.

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from gstlib.errors import ConfigError, InputError
from gstlib.geometry import Frame, Place, find_frame, spline_of
from gstlib.io.meshes import read_mesh
from gstlib.preprocess.gridding import grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import make_surface, spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = ["SecondStone", "face_in_pose", "grid_counterface", "pose_frame", "posed_mesh"]

_KEY = "counterface.pose"
# A pose moves the stone and neither stretches nor mirrors it; typed digits deviate by less.
_RIGID = 1e-3


class SecondStone(NamedTuple):
    """The active stone, and where it stands on the passive one.

    Attributes
    ----------
    mesh : trimesh.Trimesh
        mm.
    pose : mapping
        As in `pose_frame`.
    reach_mm : float
        How far around the square its face is wanted.
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
    ) -> "SecondStone":
        """The stone of a mesh's file, as in `gstlib.io.meshes.read_mesh`."""
        return cls(read_mesh(mesh, unit=mesh_unit), pose, reach_mm, str(mesh))


def pose_frame(
    pose: Mapping, frame: Frame, mesh: "trimesh.Trimesh", *, size_mm: float, source: str
) -> Frame:
    """The frame on the active mesh of the square that is laid on the passive one, turned over.

    Parameters
    ----------
    pose : mapping
        ``points_mm``, three points of the active mesh as in
        `gstlib.geometry.frame_from_points`: its own square; or ``matrix``, which takes points of
        the active mesh to the passive mesh (4 × 4, mm).
    frame : Frame
        Of the square on the passive mesh.
    mesh : trimesh.Trimesh
        The active stone, mm.
    size_mm : float
        Side of the square.
    source : str
        Name of the active mesh's file, for messages.

    Raises
    ------
    ConfigError
        The pose is none.
    """
    if "points_mm" in pose:
        try:
            return find_frame(pose["points_mm"], mesh, size_mm=size_mm, source=source)
        except ConfigError as error:  # it names the passive stone's points
            raise ConfigError(f"{_KEY}.points_mm", error.problem, error.remedy) from error
    matrix = np.asarray(pose["matrix"], float)
    turn, shift = matrix[:3, :3], matrix[:3, 3]
    unit = np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID) and np.linalg.det(turn) > 0
    if not (unit and np.allclose(matrix[3], [0, 0, 0, 1])):
        raise ConfigError(
            f"{_KEY}.matrix",
            f"{matrix.tolist()} does not move a stone: it stretches or mirrors it",
            "Give a rotation and a shift in mm, with the last row 0, 0, 0, 1.",
        )
    x_axis, _, normal = frame.axes
    corner = np.array(frame.origin) + size_mm * x_axis
    axes = ((corner - shift) @ turn, -x_axis @ turn, -normal @ turn)
    return Frame(*(axis.tolist() for axis in axes))


def posed_mesh(stone: SecondStone, frame: Frame, *, size_mm: float) -> "trimesh.Trimesh":
    """The active stone (mm) where it stands on the passive one, but for its tilt, to be looked at.

    `frame` is that of the square, of side `size_mm`, on the passive stone.
    """
    own = pose_frame(stone.pose, frame, stone.mesh, size_mm=size_mm, source=stone.source)
    turned = own.to_frame(stone.mesh.vertices) * (-1, 1, -1) + (size_mm, 0, 0)
    moved = stone.mesh.copy()
    moved.vertices = turned @ frame.axes + np.array(frame.origin)
    return moved


def grid_counterface(
    stone: SecondStone,
    surface: xr.DataArray,
    frame: Frame,
    *,
    margin_mm: float,
    interpolation: str,
) -> xr.DataArray:
    """Heights of the active stone's face over the square, and around it as far as it moves.

    Parameters
    ----------
    stone : SecondStone
    surface : (ny, nx) xarray.DataArray
        Heights of the passive stone over the square, mm above `frame`, its plane not removed.
    frame : Frame
        Of the square on the passive stone.
    margin_mm, interpolation
        As in `gstlib.preprocess.gridding.grid_mesh`.

    Returns
    -------
    (my, mx) xarray.DataArray
        Heights towards the passive stone, mm, in the square's coordinates, less the plane of those
        over the square.

    Raises
    ------
    InputError, ConfigError
        The active stone misses the square or looks away from it; the stones are apart, or in each
        other, by more than their relief; or as in `grid_mesh` and `pose_frame`.
    """
    mesh, pose, source = stone.mesh, stone.pose, stone.source
    dx = spacing_of(surface)[1]
    size = dx * surface.sizes["x"]
    own = pose_frame(pose, frame, mesh, size_mm=size, source=source)
    around = int(np.ceil(stone.reach_mm / dx))
    reach = around * dx
    origin = np.array(own.origin) - reach * own.axes[:2].sum(axis=0)
    wide = Frame(origin.tolist(), own.x_axis, own.normal)
    try:
        gridded = grid_mesh(
            mesh,
            wide,
            size_mm=size + 2 * reach,
            shape=(surface.sizes["y"] + 2 * around, surface.sizes["x"] + 2 * around),
            margin_mm=margin_mm,
            interpolation=interpolation,
            source=source,
        ).height
    except InputError as error:
        raise InputError(
            source,
            f"the active stone, as it is posed: {error.problem}",
            f"Check {_KEY} and counterface.mesh_unit in the config"
            + (f", and how far the gesture moves it ({reach:.3g} mm)." if reach else "."),
        ) from error
    face = make_surface(gridded.values[:, ::-1], dx, long_name="height of the counterface")
    face = face.assign_coords(
        {axis: face[axis].copy(data=face[axis].values - reach) for axis in "yx"}
    )
    over = face[around : around + surface.sizes["y"], around : around + surface.sizes["x"]]
    _, plane = remove_plane(over)
    if "points_mm" not in pose:
        gap = -float((surface.values + over.values).max())
        relief = sum(float(np.ptp(of.values)) for of in (surface, over))
        if abs(gap) > relief:
            where = "in" if gap < 0 else "away from"
            raise InputError(
                source,
                f"the active stone, as it is posed, is {abs(gap):.3g} mm {where} the passive one, "
                f"more than the {relief:.3g} mm between the summits and dales of both faces",
                f"Check {_KEY}: the two must touch.",
            )
    y, x = (face[axis].values - float(over[axis].mean()) for axis in "yx")
    tilted = plane.offset + plane.slope_y * y[:, None] + plane.slope_x * x
    return face.copy(data=face.values - tilted)


def face_in_pose(face: xr.DataArray, square: xr.DataArray, pose: Place) -> xr.DataArray:
    """The active face over the square, its plane removed, after the stone was moved.

    `face` is from `grid_counterface`; `square` (ny, nx) gives the grid. The stone turns about the
    middle of the square, from x towards y, and is then shifted by ``y_mm, x_mm`` of `pose`.

    Raises
    ------
    InputError
        The face does not reach so far.
    """
    middle = [float(square[axis].mean()) for axis in "yx"]
    moved = Place(middle[0] + pose.y_mm, middle[1] + pose.x_mm, pose.rotation_deg)
    y, x = np.meshgrid(square.y.values, square.x.values, indexing="ij")
    v, u = moved.seen(y, x)
    at = [v + middle[0], u + middle[1]]
    for where, axis in zip(at, "yx", strict=True):
        half = spacing_of(square)[0] / 2
        low, high = face[axis].values[[0, -1]]
        if where.min() < low - half or where.max() > high + half:
            raise InputError(
                "gesture",
                f"a pose moves the active stone by ({pose.x_mm:g}, {pose.y_mm:g}) mm and "
                f"{pose.rotation_deg:g}°, farther than its face is known",
                "Move it less.",
            )
    spline = spline_of(face)
    values = spline(at[0][:, 0], at[1][0]) if pose.rotation_deg == 0 else spline.ev(*at)
    return remove_plane(square.copy(data=values).assign_attrs(face.attrs))[0]
