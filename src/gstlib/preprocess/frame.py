"""Where the analysed square lies on the stone.

The config gives its frame as a corner with two directions, as three points, or as a marker drawn on
the stone. A direction out of the stone that is not given is found from the mesh.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gstlib.errors import ConfigError, InputError
from gstlib.io.meshes import read_points
from gstlib.preprocess.sheet import crop_mesh, find_use_face, pierce
from gstlib.surface import axis_coordinates

if TYPE_CHECKING:
    import trimesh

__all__ = ["Frame", "find_frame", "frame_from_points"]

_log = logging.getLogger(__name__)

# Axes typed with a few digits are perpendicular to within this cosine; beyond it one is wrong.
_PERPENDICULAR = 0.01
# Three points that enclose a smaller angle (its sine), or are closer than this share of the square,
# tell no direction: a pick is as wide as an edge of the mesh.
_IN_LINE, _TOO_CLOSE = 0.1, 0.1
# ASSUME: a marker outlines the square: its sides are within these shares of the square's, or it is
# another thing, or in another unit; a warning comes first.
_ODD_SIDE, _WRONG_SIDE = (0.8, 1.25), (0.5, 2.0)
# A marker thicker than this share of its width (by the spread of its points) is no outline.
_FLAT = 0.5
# The first point of a marker is at a corner of it to within this share of its shorter side.
_AT_CORNER = 0.25
# Places along each side of the square at which its use-face is looked for.
_PLACES = 20


@dataclass(frozen=True)
class Frame:
    """Where the analysed square lies on the stone, in the mesh's own coordinates (mm).

    Attributes
    ----------
    origin : (3,) array_like
        Reference corner of the square (the top-right one as one looks at the stone).
    x_axis : (3,) array_like
        Direction of an edge from the origin into the square.
    normal : (3,) array_like
        Direction out of the stone.

    Raises
    ------
    ConfigError
        An axis is no direction, or the two are not perpendicular; small deviations, as of typed
        digits, are taken out of `x_axis`.

    Examples
    --------
    >>> frame = Frame(origin=(2.5, 2.5, 0), x_axis=(-1, 0, 0), normal=(0, 0, 1))
    >>> frame.to_frame([[2.0, 1.0, 0.1]])
    array([[0.5, 1.5, 0.1]])
    """

    origin: Sequence[float]
    x_axis: Sequence[float]
    normal: Sequence[float]

    def __post_init__(self):
        vectors = {}
        for name in ("origin", "x_axis", "normal"):
            vector = np.asarray(getattr(self, name), dtype=float)
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise ConfigError(
                    f"square.frame.{name}",
                    f"{getattr(self, name)} is not three numbers",
                    "Give x, y, z.",
                )
            vectors[name] = vector
        for name in ("x_axis", "normal"):
            length = np.linalg.norm(vectors[name])
            if length == 0:
                raise ConfigError(f"square.frame.{name}", "has length zero", "Give a direction.")
            vectors[name] = vectors[name] / length
        cosine = float(vectors["x_axis"] @ vectors["normal"])
        if abs(cosine) > _PERPENDICULAR:
            raise ConfigError(
                "square.frame",
                f"x_axis and normal enclose {np.degrees(np.arccos(cosine)):.4g}°, not 90°",
                "Correct one of them.",
            )
        x_axis = vectors["x_axis"] - cosine * vectors["normal"]
        vectors["x_axis"] = x_axis / np.linalg.norm(x_axis)
        for name, vector in vectors.items():
            object.__setattr__(self, name, tuple(vector.tolist()))

    @property
    def y_axis(self) -> tuple[float, float, float]:
        """Third axis, normal × x_axis: the other edge from the origin into the square."""
        return tuple(np.cross(self.normal, self.x_axis).tolist())

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (x, y, z) in the square's frame of (n, 3) points of the mesh, mm."""
        axes = np.array([self.x_axis, self.y_axis, self.normal])
        return (np.asarray(points, dtype=float) - np.array(self.origin)) @ axes.T

    def from_frame(self, points: np.ndarray) -> np.ndarray:
        """Coordinates in the mesh of (n, 3) points (x, y, z) of the square's frame, mm."""
        axes = np.array([self.x_axis, self.y_axis, self.normal])
        return np.asarray(points, dtype=float) @ axes + np.array(self.origin)


def frame_from_points(points: Sequence[Sequence[float]]) -> Frame:
    """The frame of three points.

    Parameters
    ----------
    points : (3, 3) array_like
        The reference corner, a point along the square's x edge, and one on the side to which its y
        edge runs, mm. With x to the right, y runs up as one looks at the stone: the three turn
        anticlockwise.

    Raises
    ------
    ConfigError
        They are not three points, or in line.

    Examples
    --------
    >>> frame_from_points([(0, 0, 0), (3, 0, 0), (1, 2, 0)])
    Frame(origin=(0.0, 0.0, 0.0), x_axis=(1.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    """
    key = "square.frame.points_mm"
    corners = np.asarray(points, dtype=float)
    if corners.shape != (3, 3) or not np.isfinite(corners).all():
        raise ConfigError(key, f"{points} is not three points", "Give three times x, y, z.")
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    lengths = np.linalg.norm(first), np.linalg.norm(second)
    normal = np.cross(first, second)
    if min(lengths) == 0 or np.linalg.norm(normal) < _IN_LINE * lengths[0] * lengths[1]:
        raise ConfigError(
            key,
            f"the points {corners.tolist()} are in line, or two of them are one",
            "Give the reference corner and the two corners beside it.",
        )
    return Frame(corners[0], first, normal)


def find_frame(
    square: Mapping, mesh: "trimesh.Trimesh", *, unit: str = "mm", source: str = "mesh"
) -> Frame:
    """The frame that the config asks for.

    Parameters
    ----------
    square : mapping
        The section ``square`` of the config: ``size_mm`` and ``frame``, in which ``marker`` goes
        before ``points_mm``, and that before ``origin_mm``, ``x_axis`` and ``normal``.
    mesh : trimesh.Trimesh
        The stone, mm.
    unit : {"mm", "cm", "m", "um", "in"}
        Unit of the mesh's file, which is the marker's too.
    source : str
        Name of the mesh's file, for messages.

    Raises
    ------
    ConfigError, InputError
        What is given makes no frame, or none on this stone.

    Notes
    -----
    A marker is any file of points around the square (see `gstlib.io.meshes.read_points`), at
    whatever height over or under the surface. Its best plane is the square's. The square is centred
    on the smallest rectangle around its points, with edges along the rectangle's. The reference
    corner is the one at the marker's first point; x and y run from there so that x × y points out
    of the stone.
    """
    given = square["frame"]
    size_mm = square["size_mm"]
    if given.get("marker") is not None:
        return _marked_frame(Path(given["marker"]), mesh, size_mm, unit, source)
    if given.get("points_mm") is not None:
        return _picked_frame(given["points_mm"], mesh, size_mm, unit, source)
    return Frame(given["origin_mm"], given["x_axis"], given["normal"])


def _picked_frame(points, mesh, size_mm, unit, source) -> Frame:
    key = "square.frame.points_mm"
    frame = frame_from_points(points)
    for number, point in enumerate(points, 1):
        away = _distance(mesh, point)
        if away > size_mm:
            raise ConfigError(
                key,
                f"point {number}, {list(point)}, is {away:.4g} mm from the nearest vertex of "
                f"{source}, which spans {_span(mesh)} mm",
                "Give its coordinates in the mesh, in mm"
                + ("." if unit == "mm" else f": a viewer of this mesh shows {unit}."),
            )
    for number in (2, 3):
        near = float(np.linalg.norm(np.subtract(points[number - 1], points[0])))
        if near < _TOO_CLOSE * size_mm:
            raise ConfigError(
                key,
                f"point {number} is only {near:.4g} mm from point 1: that tells no direction",
                "Pick it at the next corner of the square.",
            )
    sides = np.linalg.norm(np.subtract(points[1:], points[0]), axis=1)
    if _is_odd(sides, size_mm):
        _log.warning(
            "%s: points 2 and 3 are %.4g and %.4g mm from point 1, the square is %g × %g mm; it "
            "begins at point 1. Pick its own corners, or correct square.size_mm",
            key,
            *sides,
            size_mm,
            size_mm,
        )
    if not _looks_out(mesh, frame, size_mm, source):
        raise ConfigError(
            key,
            "x (to point 2) and y (to point 3) turn clockwise as one looks at the stone, so that "
            "x × y points into it",
            "Exchange points 2 and 3 (x and y of the patch table change places with them), or "
            "begin at another corner.",
        )
    return frame


def _marked_frame(marker: Path, mesh, size_mm, unit, source) -> Frame:
    points = read_points(marker, unit=unit)
    distinct = np.unique(points, axis=0)
    centre, axes = _best_plane(distinct, marker)
    corners, middle = _smallest_rectangle((distinct - centre) @ axes[:2].T)
    sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
    _check_sides(sides, size_mm, marker)
    middle = centre + middle @ axes[:2]
    away = _distance(mesh, middle)
    if away > size_mm:
        raise InputError(
            marker,
            f"the marker's centre {np.round(middle, 3).tolist()} is {away:.4g} mm from the nearest "
            f"vertex of {source}, which spans {_span(mesh)} mm",
            "Export it in the coordinates and the unit of the mesh (inputs.mesh_unit).",
        )
    distances = np.linalg.norm(corners - (points[0] - centre) @ axes[:2].T, axis=1)
    first = int(np.argmin(distances))
    if distances[first] > _AT_CORNER * sides.min():
        _log.warning(
            "%s: its first point is at no corner of it; the nearest one is the reference", marker
        )
    before, after = ((corners[(first + step) % 4] - corners[first]) @ axes[:2] for step in (-1, 1))
    frame = _centred_frame(middle, after, before, size_mm)
    if not _looks_out(mesh, frame, size_mm, source):
        frame = _centred_frame(middle, before, after, size_mm)
    _log.info(
        "%s gives the square's frame: origin_mm: %s, x_axis: %s, normal: %s",
        marker,
        *(np.round(vector, 4).tolist() for vector in (frame.origin, frame.x_axis, frame.normal)),
    )
    return frame


def _centred_frame(middle, x_edge, y_edge, size_mm) -> Frame:
    """The frame of a square around `middle` with edges along two perpendicular directions."""
    x_axis, y_axis = (edge / np.linalg.norm(edge) for edge in (x_edge, y_edge))
    return Frame(middle - 0.5 * size_mm * (x_axis + y_axis), x_axis, np.cross(x_axis, y_axis))


def _best_plane(points: np.ndarray, marker: Path) -> tuple[np.ndarray, np.ndarray]:
    """Centre of the points, and three axes, the one that they spread least along last."""
    centre = points.mean(axis=0)
    if len(points) < 3:
        raise InputError(
            marker, f"it has {len(points)} different points", "Draw the corners of the square."
        )
    _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
    if spread[1] < _IN_LINE * spread[0] or spread[2] > _FLAT * spread[1]:
        shape = "in line" if spread[1] < _IN_LINE * spread[0] else "not near a plane"
        raise InputError(
            marker, f"its points are {shape}", "Draw the outline of the square, and nothing else."
        )
    return centre, axes


def _smallest_rectangle(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (4, 2), in turn, and centre (2,) of the smallest rectangle around points (n, 2)."""
    import shapely

    rectangle = shapely.MultiPoint(points).minimum_rotated_rectangle
    corners = np.array(rectangle.exterior.coords)[:4]
    return corners, corners.mean(axis=0)


def _check_sides(sides: np.ndarray, size_mm: float, marker: Path) -> None:
    low, high = sides.min() / size_mm, sides.max() / size_mm
    said = f"it is {sides[0]:.4g} × {sides[1]:.4g} mm, the square {size_mm:g} × {size_mm:g} mm"
    if low < _WRONG_SIDE[0] or high > _WRONG_SIDE[1]:
        raise InputError(
            marker,
            said,
            "Draw the outline of the square in the unit of the mesh, or correct square.size_mm.",
        )
    if _is_odd(sides, size_mm):
        _log.warning("%s: %s; the square is put at its centre", marker, said)


def _is_odd(sides: np.ndarray, size_mm: float) -> bool:
    """Whether a drawn or picked square is so much smaller or larger that it may be another one."""
    return sides.min() < _ODD_SIDE[0] * size_mm or sides.max() > _ODD_SIDE[1] * size_mm


def _looks_out(mesh: "trimesh.Trimesh", frame: Frame, size_mm: float, source: str) -> bool:
    """Whether the frame's normal points out of the stone, at the sheet nearest to the square."""
    crop = crop_mesh(
        mesh, frame.to_frame(mesh.vertices), size_mm=size_mm, margin_mm=0.0, source=source
    )
    places = axis_coordinates(_PLACES, size_mm / _PLACES)
    x, y = (grid.ravel() for grid in np.meshgrid(places, places))
    return find_use_face(crop, pierce(crop, x, y), source)[1]


def _distance(mesh: "trimesh.Trimesh", point) -> float:
    """Distance (mm) of a point from the nearest vertex."""
    return float(np.linalg.norm(np.asarray(mesh.vertices) - np.asarray(point), axis=1).min())


def _span(mesh: "trimesh.Trimesh") -> str:
    """Bounding box of a mesh, in words."""
    return ", ".join(
        f"{axis} {low:.4g} to {high:.4g}"
        for axis, low, high in zip("xyz", *mesh.bounds, strict=True)
    )
