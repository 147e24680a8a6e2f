"""Where things lie: places on the square, their outlines, and the square's frame on the stone.

On the square, y comes before x everywhere, as rows come before columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import ConfigError
from gstlib.surface import axis_coordinates, spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "FRAME",
    "Frame",
    "Place",
    "find_frame",
    "footprint_weights",
    "frame_from_points",
    "frame_variables",
    "half_extent",
    "moved",
    "on_mesh",
    "on_patch",
    "outline",
    "over_face",
    "places_of",
    "rotated",
    "spline_of",
    "square_of",
    "stored_frame",
]

# Variables of a square that hold its frame.
FRAME = "origin", "x_axis", "normal"
# If three points enclose a smaller angle (its sine), they define no direction.
_IN_LINE = 0.1


def rotated(v: Any, u: Any, rotation_deg: float) -> tuple[Any, Any]:
    """Offsets along y and x of what lies (v, u) along axes that are turned from x towards y."""
    turn = np.radians(rotation_deg)
    return np.cos(turn) * v + np.sin(turn) * u, np.cos(turn) * u - np.sin(turn) * v


class Place(NamedTuple):
    """Where a scan lies on the square: its centre (mm) and its turn from x towards y."""

    y_mm: float
    x_mm: float
    rotation_deg: float = 0.0

    @classmethod
    def of(cls, at: xr.Dataset) -> "Place":
        """The place of one patch, from its ``y_mm, x_mm, rotation_deg``."""
        return cls(*(float(at[name]) for name in cls._fields))

    def points(self, v: Any, u: Any) -> tuple[Any, Any]:
        """Places (y, x) on the square of points (v, u) from the scan's centre, mm."""
        dy, dx = rotated(v, u, self.rotation_deg)
        return self.y_mm + dy, self.x_mm + dx

    def seen(self, y: Any, x: Any) -> tuple[Any, Any]:
        """Places (v, u) from the scan's centre of points (y, x) on the square, mm."""
        return rotated(y - self.y_mm, x - self.x_mm, -self.rotation_deg)


def places_of(patches: pd.DataFrame) -> dict[str, Place]:
    """Place of each patch, from ``patch, x_mm, y_mm, rotation_deg``."""
    rows = patches[["patch", "y_mm", "x_mm", "rotation_deg"]].itertuples(index=False)
    return {patch: Place(*map(float, place)) for patch, *place in rows}


def spline_of(field: xr.DataArray) -> "scipy.interpolate.RectBivariateSpline":
    """Cubic spline of a field (y, x) through its element centres; it is constant beyond them.

    Where the field is NaN, it takes the nearest value.
    """
    values = _filled(field.values)
    return scipy.interpolate.RectBivariateSpline(field.y.values, field.x.values, values)


def _filled(values: np.ndarray) -> np.ndarray:
    """Values (ny, nx), NaN replaced by the nearest ones."""
    if not (absent := np.isnan(values)).any():
        return values
    nearest = scipy.ndimage.distance_transform_edt(
        absent, return_distances=False, return_indices=True
    )
    return values[tuple(nearest)]


def square_of(field: xr.DataArray | xr.Dataset, size_mm: float) -> Any:
    """The part of a field (..., y, x) of the face that lies in the square of this side."""
    inside = {axis: (field[axis].values > 0) & (field[axis].values < size_mm) for axis in "yx"}
    return field.isel({axis: np.flatnonzero(of) for axis, of in inside.items()})


def on_patch(
    spline: "scipy.interpolate.RectBivariateSpline",
    place: Place,
    shape: tuple[int, ...],
    size_mm: float,
) -> np.ndarray:
    """A field of the square at the points, of this `shape`, of the scan that lies at a place."""
    v, u = (axis_coordinates(count, size_mm / count) - size_mm / 2 for count in shape)
    if place.rotation_deg == 0:  # many times as fast
        return spline(place.y_mm + v, place.x_mm + u)
    return spline.ev(*place.points(v[:, None], u))


def outline(place: Place, size_mm: float) -> np.ndarray:
    """Corners (4, 2), x and y (mm), of a square footprint, to be drawn; the lower left first."""
    v, u = size_mm / 2 * np.array([[-1, -1, 1, 1], [-1, 1, 1, -1]])
    y, x = place.points(v, u)
    return np.column_stack([x, y])


def footprint_weights(grid: xr.DataArray, place: Place, size_mm: float) -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a square footprint, exactly.

    `grid` is any field on the grid, dims (..., y, x); `size_mm` is the footprint's side.
    """
    dy, dx = spacing_of(grid)
    y, x, half = grid.y.values, grid.x.values, size_mm / 2
    if place.rotation_deg == 0:  # as exact, and a hundred times as fast
        overlap = []
        for at, step, centre in ((y, dy, place.y_mm), (x, dx, place.x_mm)):
            low, high = at - step / 2, at + step / 2
            inside = np.minimum(high, centre + half) - np.maximum(low, centre - half)
            overlap.append(np.clip(inside, 0, None))
        return np.outer(*overlap) / (dy * dx)
    import shapely

    y, x = np.meshgrid(y, x, indexing="ij")
    near = (abs(y - place.y_mm) < size_mm + dy) & (abs(x - place.x_mm) < size_mm + dx)
    y, x, weights = y[near], x[near], np.zeros(near.shape)
    elements = shapely.box(x - dx / 2, y - dy / 2, x + dx / 2, y + dy / 2)
    inside = shapely.intersection(elements, shapely.polygons(outline(place, size_mm)))
    weights[near] = shapely.area(inside) / (dy * dx)
    return weights


def half_extent(size_mm: float, rotation_deg: Any) -> Any:
    """How far a rotated footprint reaches from its centre along x and y, mm."""
    angle = np.radians(rotation_deg)
    return size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))


def moved(
    patches: pd.DataFrame,
    shift_mm: Sequence[float | np.ndarray] | np.ndarray,
    face: xr.DataArray,
    size_mm: float,
) -> pd.DataFrame:
    """The patches moved along y and x, all alike or each by itself; none leaves the face.

    `face` is any field on it; `size_mm` is the side of a patch.
    """
    half = half_extent(size_mm, patches.rotation_deg.to_numpy())
    found = {}
    for name, by, axis, step in zip(
        ("y_mm", "x_mm"), shift_mm, "yx", spacing_of(face), strict=True
    ):
        along = face[axis].values
        first, last = along[0] - step / 2 + half, along[-1] + step / 2 - half
        found[name] = np.clip(patches[name].to_numpy() + by, first, last)
    return patches.assign(**found)


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
        x, normal = np.asarray(self.x_axis, float), np.asarray(self.normal, float)
        x, normal = x / np.linalg.norm(x), normal / np.linalg.norm(normal)
        return np.array([x, np.cross(normal, x), normal])

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (x, y, z) in the frame of (n, 3) points of the mesh, mm."""
        return (np.asarray(points, dtype=float) - np.array(self.origin)) @ self.axes.T


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
    if not np.linalg.norm(normal) > _IN_LINE * np.linalg.norm(first) * np.linalg.norm(second):
        raise ConfigError(
            "square.points_mm",
            f"the points {corners.tolist()} are in line, or two of them are the same",
            "Give the reference corner and the two corners beside it.",
        )
    axes = Frame(corners[0], first, normal).axes.tolist()
    return Frame(corners[0].tolist(), axes[0], axes[2])


def frame_variables(frame: Frame) -> dict[str, tuple]:
    """A frame as variables (axis) of a dataset, as `stored_frame` reads them."""
    described = {
        "origin": ("mm", frame.origin, "reference corner of the square on the mesh"),
        "x_axis": ("1", frame.x_axis, "direction of the square's x on the mesh"),
        "normal": ("1", frame.normal, "direction out of the stone on the mesh"),
    }
    return {
        name: ("axis", np.asarray(values, dtype=float), {"units": units, "long_name": text})
        for name, (units, values, text) in described.items()
    }


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
    vertices = np.asarray(mesh.vertices)
    for number, point in enumerate(points_mm, 1):
        away = float(np.linalg.norm(vertices - np.asarray(point), axis=1).min())
        if away > size_mm:
            span = " to ".join(str(np.round(end, 4).tolist()) for end in mesh.bounds)
            raise ConfigError(
                "square.points_mm",
                f"point {number}, {list(point)}, is {away:.4g} mm from the nearest vertex of "
                f"{source}, which spans {span} mm",
                "Give its coordinates in mm, as gst pick does, whatever the unit of the mesh.",
            )
    return frame_from_points(points_mm)


def over_face(
    mesh: "trimesh.Trimesh", frame: Frame, face: xr.DataArray, margin: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices of a mesh in the square's frame, and which of them lie over the face on its side.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm.
    frame : Frame
        Of the square.
    face : (y, x) xarray.DataArray
        Any field on the square, or on the face around it.
    margin : float
        How far beyond it a vertex may lie (mm).

    Returns
    -------
    places : (n, 3) ndarray
    is_over : (n,) ndarray of bool
    """
    places = frame.to_frame(mesh.vertices)
    low, high = (
        np.array([face[axis].values[end] for axis in "xy"]) + side * spacing_of(face)[0]
        for end, side in ((0, -0.5), (-1, 0.5))
    )
    faces_out = mesh.vertex_normals @ np.array(frame.normal) > 0
    is_over = ((places[:, :2] >= low - margin) & (places[:, :2] <= high + margin)).all(axis=1)
    over = np.flatnonzero(is_over & faces_out)
    # If an arm of the stone lies above or below, the face is on the side nearest to its plane.
    nearest = places[over[np.argmin(np.abs(places[over, 2]))], 2]
    near = np.abs(places[:, 2] - nearest) < (high - low).max()
    return places, is_over & faces_out & near


def on_mesh(field: xr.DataArray, mesh: "trimesh.Trimesh", frame: Frame) -> np.ndarray:
    """A field (y, x) of the face at each vertex of a mesh: that of its element, 0 elsewhere."""
    places, is_over = over_face(mesh, frame, field)
    row, column = (
        np.clip(((places[is_over, axis] - at[0]) / step + 0.5).astype(int), 0, len(at) - 1)
        for axis, at, step in (
            (1, field.y.values, spacing_of(field)[0]),
            (0, field.x.values, spacing_of(field)[1]),
        )
    )
    found = np.zeros(len(places))
    found[is_over] = np.nan_to_num(field.values[row, column])
    return found
