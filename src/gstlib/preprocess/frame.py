"""Where the analysed square lies on the stone: three points give its frame."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gstlib.errors import ConfigError

if TYPE_CHECKING:
    import trimesh

__all__ = ["Frame", "find_frame", "frame_from_points", "stored_frame"]

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


def stored_frame(attributes: Mapping[str, Any]) -> Frame:
    """The frame in the attributes of ``macroscale/surface.h5``."""
    return Frame(*(attributes[name].tolist() for name in ("origin_mm", "x_axis", "normal")))


def find_frame(square: Mapping, mesh: "trimesh.Trimesh", *, source: str = "mesh") -> Frame:
    """The frame that the config asks for.

    `square` is the section of that name, with ``size_mm`` and ``points_mm``; `mesh` is the stone,
    mm, and `source` its file, for messages.

    Raises
    ------
    ConfigError
        The points define no frame, or one is farther from the stone than the square is wide.
    """
    for number, point in enumerate(square["points_mm"], 1):
        away = float(
            np.linalg.norm(np.asarray(mesh.vertices) - np.asarray(point), axis=1).min()
        )
        if away > square["size_mm"]:
            span = " to ".join(str(np.round(end, 4).tolist()) for end in mesh.bounds)
            raise ConfigError(
                "square.points_mm",
                f"point {number}, {list(point)}, is {away:.4g} mm from the nearest vertex of "
                f"{source}, which spans {span} mm",
                "Give its coordinates in mm, as gst pick does, whatever the unit of the mesh.",
            )
    return frame_from_points(square["points_mm"])
