"""The use-face of a stone's mesh: the side that faces the square.

The normal through a point of the square meets a closed mesh twice, and a hollow or damaged mesh
more often. The faces near the square form connected bodies, each with an upper and a lower side.
The use-face is the side nearest to the square's plane among the sides that cover most of the
square.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from gstlib.errors import InputError
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import axis_coordinates

if TYPE_CHECKING:
    import trimesh

__all__ = ["Layout", "UseFace", "find_use_face"]

_log = logging.getLogger(__name__)

# ASSUME: End of the use-face. Beyond the square, elements that the mesh covers not at all or twice
# contain no stone. In the square they are a fault. Reason: Outside the square, the use-face ends or
# turns away there.
# ASSUME: Small overhangs. Overhangs up to 0.1 % of the square are accepted. Reason: They are specks
# of the scanner.
_FOLDED_FRACTION = 1e-3
# Heights of one element that differ by less (mm) count as one: the element is on an edge.
_SAME_HEIGHT = 1e-6
# Two surfaces that look the same way and are less apart (mm) are one, scanned twice.
_DOUBLE_MM = 0.5
# A body whose underside is under more than this share of the square has one.
_JOINED = 0.5
# A face seen edge-on (area in mm²) covers nothing.
_EDGE_ON = 1e-12
# ASSUME: Thickness of a stone. The thickness of a stone is the 5th percentile of its thickness
# under the square. Reason: Thinner parts are a flap, a speck or the rim, and do not make the whole
# stone bend.
_THIN_PERCENTILE = 5.0
# Margin of the cropped cloud around the grid. In the paper it is "bigger than the square".
_MARGIN_MM = 1.0


@dataclass(frozen=True)
class Layout:
    """The elements of a square (mm), and of the face around it."""

    size_mm: float
    grid: int
    around: int

    @property
    def spacing(self) -> float:
        return self.size_mm / self.grid

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the face, along both axes."""
        margin = self.around * self.spacing
        return -margin, self.size_mm + margin

    @cached_property
    def along(self) -> np.ndarray:
        """Element centres (n,), along both axes."""
        count = self.grid + 2 * self.around
        return axis_coordinates(count, self.spacing) + self.bounds[0]

    @cached_property
    def centres(self) -> tuple[np.ndarray, ...]:
        """y and x (n, n) of the element centres."""
        return np.meshgrid(self.along, self.along, indexing="ij")

    @cached_property
    def in_square(self) -> np.ndarray:
        """Mask (n, n)."""
        inside = (self.along > 0) & (self.along < self.size_mm)
        return np.outer(inside, inside)

    def share_of_square(self, mask: np.ndarray) -> str:
        """The share of the square that a mask (n, n) covers, and its position."""
        y, x = (centre[mask] for centre in self.centres)
        return (
            f"{100 * mask[self.in_square].mean():.3g} % of the square (x {x.min():.3g} to "
            f"{x.max():.3g}, y {y.min():.3g} to {y.max():.3g} mm)"
        )


class UseFace(NamedTuple):
    """The use-face, in the square's frame (mm).

    Attributes
    ----------
    cloud : (k, 3) ndarray
        Its vertices.
    edge : float
        Mean length of its edges.
    ends : (n, n) ndarray of bool
        Elements beyond the square without stone.
    bare : (n, n) ndarray of bool
        Elements of the square that no face of it covers.
    thickness : float
        Thickness of the stone under the square (low percentile), NaN for a mesh without underside.
    """

    cloud: np.ndarray
    edge: float
    ends: np.ndarray
    bare: np.ndarray
    thickness: float


def find_use_face(
    mesh: "trimesh.Trimesh", frame: Frame, layout: Layout, *, source: str
) -> UseFace:
    """The use-face of a mesh over a square and around it.

    For the parameters, see `gstlib.preprocess.mesh.grid_mesh`.

    Raises
    ------
    InputError
        The square misses the stone. The use-face folds over within it, or faces into the stone.
    """
    vertices = frame.to_frame(mesh.vertices)
    near = _near(vertices, mesh, layout)
    hits = _hits(near, layout)
    if not hits.in_square.any():
        (x_low, y_low, _), (x_high, y_high, _) = (
            vertices.min(axis=0),
            vertices.max(axis=0),
        )
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {x_low:.4g} to {x_high:.4g} and y {y_low:.4g} to {y_high:.4g} mm, "
            f"the square 0 to {layout.size_mm:g} mm",
            "Check inputs.mesh_unit and square.points_mm in the config.",
        )
    use_side = _side_of_use(hits, source)
    lowest, highest, below = _heights_met(hits, use_side, layout)
    apart = highest - lowest
    folded, bare = apart > _SAME_HEIGHT, np.isnan(highest)
    overhang = folded & layout.in_square
    if overhang.sum() > _FOLDED_FRACTION * layout.grid**2:
        raise InputError(
            source,
            f"the mesh folds over within the square: {layout.share_of_square(overhang)} has two "
            f"heights, up to {apart[overhang].max():.3g} mm apart",
            "Move square.points_mm so that the square faces the use-face squarely, or repair "
            "the mesh.",
        )
    is_own = near.sides == use_side
    triangles = near.triangles[is_own]
    edges = triangles - np.roll(triangles, 1, axis=1)
    through = (highest - below)[layout.in_square & ~np.isnan(below)]
    thickness = np.percentile(through, _THIN_PERCENTILE) if len(through) else np.nan
    return UseFace(
        cloud=vertices[np.unique(near.faces[is_own])],
        edge=float(np.linalg.norm(edges, axis=2).mean()),
        ends=(folded | bare) & ~layout.in_square,
        bare=bare & layout.in_square,
        thickness=float(thickness),
    )


class _Near(NamedTuple):
    """The faces of a mesh near the face of a layout.

    `faces` (m, 3) are numbers of vertices, and `triangles` (m, 3, 3) their places in the square's
    frame (mm). The `normals` (m, 3) are twice as long as the faces are large. `bodies` (m,) numbers
    the connected parts of the whole mesh. `sides` (m,) are numbers of the parts of these faces, an
    even one for faces that look down, and an odd one for faces that look up.
    """

    faces: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    bodies: np.ndarray
    sides: np.ndarray


def _near(vertices: np.ndarray, mesh: "trimesh.Trimesh", layout: Layout) -> _Near:
    """The faces of a mesh, with `vertices` in the square's frame, near the face of the layout."""
    low, high = layout.bounds
    corners = vertices[:, :2][mesh.faces]
    begins_before = corners.min(axis=1) <= high + _MARGIN_MM
    ends_behind = corners.max(axis=1) >= low - _MARGIN_MM
    is_near = (begins_before & ends_behind).all(axis=1)
    faces = mesh.faces[is_near]
    triangles = vertices[faces]
    a, b, c = triangles.swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    bodies = _connected(mesh.faces, len(vertices))[is_near]
    sides = 2 * _connected(faces, len(vertices)) + (normals[:, 2] > 0)
    return _Near(faces, triangles, normals, bodies, sides)


def _connected(faces: np.ndarray, vertices: int) -> np.ndarray:
    """The number (m,) of the connected part of each face (m, 3), of so many vertices."""
    from trimesh.graph import connected_component_labels

    edges = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    return connected_component_labels(edges, vertices)[faces[:, 0]]


def _hits(near: _Near, layout: Layout) -> pd.DataFrame:
    """Intersections of the normals through the element centres with faces not seen edge-on.

    The result has the number of the ``element``, ``in_square``, the ``height`` (mm), and the
    ``body`` and ``side`` of the face.
    """
    # trimesh's rays miss hits on shared edges or count them twice, and need further packages.
    import shapely

    y, x = (centre.ravel() for centre in layout.centres)
    numbers = np.flatnonzero(np.abs(near.normals[:, 2]) > 2 * _EDGE_ON)
    rings = near.triangles[numbers][:, [0, 1, 2, 0], :2]
    tree = shapely.STRtree(shapely.polygons(rings))
    element, hit = tree.query(shapely.points(x, y), predicate="intersects")
    face = numbers[hit]
    a, normal = near.triangles[face, 0].T, near.normals[face].T
    rise = normal[0] * (x[element] - a[0]) + normal[1] * (y[element] - a[1])
    return pd.DataFrame(
        {
            "element": element,
            "in_square": layout.in_square.ravel()[element],
            "height": a[2] - rise / normal[2],
            "body": near.bodies[face],
            "side": near.sides[face],
        }
    )


def _side_of_use(hits: pd.DataFrame, source: str) -> int:
    """The number of the side that is the use-face."""
    sides = hits[hits.in_square].groupby("side").height.agg(["size", "median"])
    # Specks, flaps and the inside of a hollow scan are no candidates.
    heights = sides["median"][sides["size"] >= 0.5 * sides["size"].max()]
    use_side = heights.abs().idxmin()
    others = heights[(heights.index % 2 == use_side % 2) & (heights.index != use_side)]
    apart = (others - heights[use_side]).abs().min()
    if apart < _DOUBLE_MM:
        _log.warning(
            "%s: the mesh has a second surface over the square, %.2g mm from the one used. "
            "If it was scanned twice, merge the two scans",
            source,
            apart,
        )
    if use_side % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square point against the frame's normal",
            "Exchange points 2 and 3 of square.points_mm if they do not go anticlockwise as you "
            "look at the stone; if they do, turn the mesh's faces.",
        )
    return use_side


def _heights_met(
    hits: pd.DataFrame, use_side: int, layout: Layout
) -> Iterator[np.ndarray]:
    """Lowest and highest height of the use-face at each element (n, n), and of its underside.

    The underside belongs to the body of the use-face. If this body has no underside, as when the
    two sides of a stone were not joined, any other body is used.
    """
    own = hits[hits.side == use_side]
    highest = own.groupby("element").height.max()
    is_below = hits.height < hits.element.map(highest)
    under = hits[hits.in_square & (hits.side % 2 == 0) & is_below]
    same = under[under.body == own.body.iloc[0]]
    if same.element.nunique() > _JOINED * layout.grid**2:
        under = same
    lowest = own.groupby("element").height.min()
    below = under.groupby("element").height.max()
    for heights in (lowest, highest, below):
        every = heights.reindex(range(layout.in_square.size))
        yield every.to_numpy().reshape(layout.in_square.shape)
