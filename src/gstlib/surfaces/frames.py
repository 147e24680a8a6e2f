"""The frame of the analysed square on the stone."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import ConfigError
from gstlib.surfaces.grid import spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "FRAME",
    "Frame",
    "find_frame",
    "frame_from_points",
    "frame_variables",
    "on_mesh",
    "over_face",
    "stored_frame",
]

# Variables of a square that contain its frame: unit and meaning.
_VARIABLES = {
    "origin": ("mm", "reference corner of the square on the mesh"),
    "x_axis": ("1", "direction of the square's x on the mesh"),
    "normal": ("1", "direction out of the stone on the mesh"),
}
FRAME = tuple(_VARIABLES)
# If three points enclose a smaller angle (its sine), they define no direction.
_IN_LINE = 0.1


@dataclass(frozen=True)
class Frame:
    """A frame on the stone, of the analysed square or of a view, in the mesh's coordinates (mm).

    Attributes
    ----------
    origin : (3,) array_like
        Reference corner of the square.
    x_axis : (3,) array_like
        Direction of an edge from the origin into the square.
    normal : (3,) array_like
        Direction out of the stone, perpendicular to `x_axis`. Both may be of any length.

    Examples
    --------
    >>> frame = Frame(origin=(2.5, 2.5, 0), x_axis=(-1, 0, 0), normal=(0, 0, 1))
    >>> frame.to_frame([[2.0, 1.0, 0.1]])
    array([[0.5, 1.5, 0.1]])
    """

    origin: Sequence[float] | np.ndarray
    x_axis: Sequence[float] | np.ndarray
    normal: Sequence[float] | np.ndarray

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors (3, 3) along x, y = normal × x, and the normal, one per row.

        Points in the frame times these, plus the origin, are points of the mesh.
        """
        x, normal = (
            np.divide(axis, np.linalg.norm(axis)) for axis in (self.x_axis, self.normal)
        )
        return np.array([x, np.cross(normal, x), normal])

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (x, y, z) in the frame of (n, 3) points of the mesh, mm."""
        return np.subtract(points, self.origin) @ self.axes.T


def frame_from_points(points: Sequence[Sequence[float]]) -> Frame:
    """The frame of three points.

    Parameters
    ----------
    points : (3, 3) array_like
        The reference corner, a point along the square's x edge, and one on the side to which its y
        edge runs, mm. Seen from outside the stone, y runs up if x runs to the right: the three go
        anticlockwise.

    Raises
    ------
    ConfigError
        They are in line.

    Examples
    --------
    >>> frame_from_points([(0, 0, 0), (3, 0, 0), (1, 2, 0)])
    Frame(origin=[0.0, 0.0, 0.0], x_axis=[1.0, 0.0, 0.0], normal=[0.0, 0.0, 1.0])
    """
    corners = np.asarray(points, dtype=float)
    first, second = corners[1:] - corners[0]
    normal = np.cross(first, second)
    least = _IN_LINE * np.linalg.norm(first) * np.linalg.norm(second)
    if not np.linalg.norm(normal) > least:
        raise ConfigError(
            "square.points_mm",
            f"the points {corners.tolist()} are in line, or two of them are the same",
            "Give the reference corner and the two corners beside it.",
        )
    axes = Frame(corners[0], first, normal).axes.tolist()
    return Frame(corners[0].tolist(), axes[0], axes[2])


def frame_variables(frame: Frame) -> dict[str, tuple]:
    """A frame as variables (axis) of a dataset, as `stored_frame` reads them."""
    variables = {}
    for name, (units, long_name) in _VARIABLES.items():
        attrs = {"units": units, "long_name": long_name}
        variables[name] = ("axis", np.asarray(getattr(frame, name), float), attrs)
    return variables


def stored_frame(square: xr.Dataset) -> Frame:
    """The frame of a square, from its variables `FRAME`."""
    return Frame(*(square[name].values.tolist() for name in FRAME))


def find_frame(
    points_mm: Sequence[Sequence[float]],
    mesh: "trimesh.Trimesh",
    *,
    size_mm: float,
    source: str = "mesh",
) -> Frame:
    """The frame of three points on a stone, as in `frame_from_points`.

    `mesh` is the stone, mm, `size_mm` the side of the square, and `source` the mesh's file, for
    messages.

    Raises
    ------
    ConfigError
        The points define no frame, or one is farther from the stone than the square is wide.
    """
    for number, point in enumerate(points_mm, 1):
        away = np.linalg.norm(np.subtract(mesh.vertices, point), axis=1).min()
        if away > size_mm:
            span = " to ".join(str(np.round(end, 4).tolist()) for end in mesh.bounds)
            raise ConfigError(
                "square.points_mm",
                f"point {number}, {list(point)}, is {away:.4g} mm from the nearest vertex of "
                f"{source}, which spans {span} mm",
                "Give its coordinates in mm, as gst place does, whatever the unit of the mesh.",
            )
    return frame_from_points(points_mm)


def over_face(
    mesh: "trimesh.Trimesh", frame: Frame, face: xr.DataArray, margin: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a mesh in the square's frame, and which of them are over the face on its side.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm.
    frame : Frame
        Of the square.
    face : (y, x) xarray.DataArray
        Any field on the square, or on the face around it.
    margin : float
        Largest distance (mm) of a vertex beyond it.

    Returns
    -------
    places : (n, 3) ndarray
    is_over : (n,) ndarray of bool
    """
    places = frame.to_frame(mesh.vertices)
    x_and_y, z = places[:, :2], places[:, 2]
    corners = np.array([face[axis].values[[0, -1]] for axis in "xy"])
    middle = corners.mean(axis=1)
    half = np.ptp(corners, axis=1) / 2 + spacing_of(face)[0] / 2
    is_inside = (np.abs(x_and_y - middle) <= half + margin).all(axis=1)
    is_over = is_inside & (mesh.vertex_normals @ np.array(frame.normal) > 0)
    # If an arm of the stone is above or below, the face is on the side nearest to its plane.
    nearest = min(z[is_over], key=abs)
    return places, is_over & (np.abs(z - nearest) < 2 * half.max())


def on_mesh(field: xr.DataArray, mesh: "trimesh.Trimesh", frame: Frame) -> np.ndarray:
    """A field (y, x) of the face at each vertex of a mesh: the value of its element, or 0."""
    places, is_over = over_face(mesh, frame, field)
    x, y = (xr.DataArray(places[is_over, axis], dims="vertex") for axis in (0, 1))
    over = field.sel(y=y, x=x, method="nearest")
    at_vertices = np.zeros(len(places))
    at_vertices[is_over] = np.nan_to_num(over.values)
    return at_vertices
