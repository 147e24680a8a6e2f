"""Where the analysed square lies on the stone: a corner with two directions, or three points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gstlib.errors import ConfigError

if TYPE_CHECKING:
    import trimesh

__all__ = ["Frame", "find_frame", "frame_from_points", "principal_axes", "stored_frame"]

# Axes typed with a few digits are perpendicular to within this cosine; beyond it one is wrong.
_PERPENDICULAR = 0.01
# Three points that enclose a smaller angle (its sine) give no direction.
_IN_LINE = 0.1


@dataclass(frozen=True)
class Frame:
    """Where the analysed square lies on the stone, in the mesh's own coordinates (mm).

    Attributes
    ----------
    origin : (3,) array_like
        Reference corner of the square.
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

    def __post_init__(self) -> None:
        origin, x_axis, normal = (
            np.asarray(vector, dtype=float) for vector in (self.origin, self.x_axis, self.normal)
        )
        if not (x_axis.any() and normal.any()):
            raise ConfigError("square.frame", "an axis has length zero", "Give a direction.")
        x_axis, normal = x_axis / np.linalg.norm(x_axis), normal / np.linalg.norm(normal)
        cosine = float(np.dot(x_axis, normal))
        if abs(cosine) > _PERPENDICULAR:
            raise ConfigError(
                "square.frame",
                f"x_axis and normal enclose {np.degrees(np.arccos(cosine)):.4g}°, not 90°",
                "Correct one of them.",
            )
        x_axis = x_axis - cosine * normal
        x_axis /= np.linalg.norm(x_axis)
        for name, vector in (("origin", origin), ("x_axis", x_axis), ("normal", normal)):
            object.__setattr__(self, name, tuple(vector.tolist()))

    @property
    def y_axis(self) -> tuple[float, ...]:
        """Third axis, normal × x_axis: the other edge from the origin into the square."""
        return tuple(np.cross(self.normal, self.x_axis).tolist())

    def to_frame(self, points: np.ndarray) -> np.ndarray:
        """Coordinates (x, y, z) in the square's frame of (n, 3) points of the mesh, mm."""
        axes = np.array([self.x_axis, self.y_axis, self.normal])
        return (np.asarray(points, dtype=float) - np.array(self.origin)) @ axes.T


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
        They are in line.

    Examples
    --------
    >>> frame_from_points([(0, 0, 0), (3, 0, 0), (1, 2, 0)])
    Frame(origin=(0.0, 0.0, 0.0), x_axis=(1.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    """
    corners = np.asarray(points, dtype=float)
    first, second = corners[1:] - corners[0]
    normal = np.cross(first, second)
    if not np.linalg.norm(normal) > _IN_LINE * np.linalg.norm(first) * np.linalg.norm(second):
        raise ConfigError(
            "square.frame.points_mm",
            f"the points {corners.tolist()} are in line, or two of them are one",
            "Give the reference corner and the two corners beside it.",
        )
    return Frame(corners[0].tolist(), first.tolist(), normal.tolist())


def stored_frame(attributes: Mapping[str, Any]) -> Frame:
    """The frame in the attributes of ``macroscale/surface.h5``."""
    return Frame(*(attributes[name].tolist() for name in ("origin_mm", "x_axis", "normal")))


def principal_axes(mesh: "trimesh.Trimesh") -> np.ndarray:
    """Directions (3, 3) of the principal axes of a mesh's vertices, a row each, the longest first.

    Examples
    --------
    >>> import trimesh
    >>> principal_axes(trimesh.creation.box((10, 30, 20))).round(9) + 0
    array([[0., 1., 0.],
           [0., 0., 1.],
           [1., 0., 0.]])
    """
    axes = np.linalg.eigh(np.cov(np.asarray(mesh.vertices).T))[1].T[::-1]
    # The signs that eigh gives are arbitrary.
    return axes * np.sign([axis[np.abs(axis).argmax()] for axis in axes])[:, np.newaxis]


def find_frame(
    square: Mapping, mesh: "trimesh.Trimesh", *, unit: str = "mm", source: str = "mesh"
) -> Frame:
    """The frame that the config asks for.

    Parameters
    ----------
    square : mapping
        The section ``square`` of the config: ``size_mm`` and ``frame``, in which ``points_mm`` goes
        before ``origin_mm``, ``x_axis`` and ``normal``.
    mesh : trimesh.Trimesh
        The stone, mm.
    unit : {"mm", "cm", "m", "um", "in"}
        Unit of the mesh's file, for messages.
    source : str
        Name of the mesh's file, for messages.

    Raises
    ------
    ConfigError
        What is given makes no frame, or a point is farther from the stone than the square is wide.
    """
    given, size_mm = square["frame"], square["size_mm"]
    if given["points_mm"] is None:
        return Frame(given["origin_mm"], given["x_axis"], given["normal"])
    for number, point in enumerate(given["points_mm"], 1):
        away = float(np.linalg.norm(np.asarray(mesh.vertices) - np.asarray(point), axis=1).min())
        if away > size_mm:
            span = " to ".join(str(np.round(end, 4).tolist()) for end in mesh.bounds)
            raise ConfigError(
                "square.frame.points_mm",
                f"point {number}, {list(point)}, is {away:.4g} mm from the nearest vertex of "
                f"{source}, which spans {span} mm",
                "Give its coordinates in the mesh, in mm"
                + ("." if unit == "mm" else f": a viewer of this mesh shows {unit}."),
            )
    return frame_from_points(given["points_mm"])
