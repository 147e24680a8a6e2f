"""The use-face of a stone's mesh: the side that faces the square.

The normal through a point of the square meets a closed mesh twice, and a hollow or damaged mesh
more often. The faces near the square form connected bodies, each with an upper and a lower side.
The use-face is the side nearest to the square's plane among the sides that cover most of the
square.
"""

import logging
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

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
        return -self.around * self.spacing, self.size_mm + self.around * self.spacing

    @cached_property
    def along(self) -> np.ndarray:
        """Element centres (n,), along both axes."""
        return (
            axis_coordinates(self.grid + 2 * self.around, self.spacing) + self.bounds[0]
        )

    @cached_property
    def centres(self) -> tuple[np.ndarray, np.ndarray]:
        """y and x (n, n) of the element centres."""
        y, x = np.meshgrid(self.along, self.along, indexing="ij")
        return y, x

    @cached_property
    def in_square(self) -> np.ndarray:
        """Mask (n, n)."""
        mask = np.zeros(2 * (len(self.along),), bool)
        square = slice(self.around, self.around + self.grid)
        mask[square, square] = True
        return mask

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
    crop = _cropped(mesh, frame, layout)
    hits = _hits(crop, layout)
    if not layout.in_square.ravel()[hits.element].any():
        raise _missed(mesh, frame, layout, source)
    is_own = _side_of_use(crop, hits, layout, source)
    lowest, highest, below = _heights_met(crop, hits, is_own, layout)
    folded, bare = highest - lowest > _SAME_HEIGHT, np.isnan(highest)
    _check_folds(folded, highest - lowest, layout, source)
    own = crop.faces[is_own]
    triangles = crop.points[own]
    edges = triangles - np.roll(triangles, 1, axis=1)
    has_underside = layout.in_square & ~np.isnan(below)
    through = (highest - below)[has_underside]
    thickness = (
        float(np.percentile(through, _THIN_PERCENTILE)) if len(through) else np.nan
    )
    return UseFace(
        cloud=crop.points[np.unique(own)],
        edge=float(np.linalg.norm(edges, axis=2).mean()),
        ends=(folded | bare) & ~layout.in_square,
        bare=bare & layout.in_square,
        thickness=thickness,
    )


class _Crop(NamedTuple):
    """The part of a mesh near a face, in the square's frame (mm).

    `points` (n, 3), `faces` (m, 3), and their `areas` (m,) projected along the frame's normal,
    positive if a face points up. `bodies` (m,) numbers the connected parts of the whole mesh.
    """

    points: np.ndarray
    faces: np.ndarray
    areas: np.ndarray
    bodies: np.ndarray


class _Hits(NamedTuple):
    """Intersections of normals through element centres with a mesh: element, face, height (mm)."""

    element: np.ndarray
    face: np.ndarray
    height: np.ndarray


def _cropped(mesh: "trimesh.Trimesh", frame: Frame, layout: Layout) -> _Crop:
    """The faces near the face of the layout."""
    from trimesh.graph import connected_component_labels

    vertices = frame.to_frame(mesh.vertices)
    corners = vertices[:, :2][mesh.faces]
    low, high = layout.bounds
    begins_before = corners.min(axis=1) <= high + _MARGIN_MM
    ends_behind = corners.max(axis=1) >= low - _MARGIN_MM
    near = (begins_before & ends_behind).all(axis=1)
    used, inverse = np.unique(mesh.faces[near], return_inverse=True)
    points, faces = vertices[used], inverse.reshape(-1, 3)
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    (bx, by), (cx, cy) = (b - a).T, (c - a).T
    areas = 0.5 * (bx * cy - by * cx)
    edges = mesh.faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    body = connected_component_labels(edges, len(vertices))
    return _Crop(points, faces, areas, body[mesh.faces[near, 0]])


def _hits(crop: _Crop, layout: Layout) -> _Hits:
    """Intersections of the normals through the element centres with faces not seen edge-on."""
    # trimesh's rays miss hits on shared edges or count them twice, and need further packages.
    import shapely

    y, x = (centre.ravel() for centre in layout.centres)
    numbers = np.flatnonzero(np.abs(crop.areas) > _EDGE_ON)
    triangles = crop.points[crop.faces[numbers]]
    rings = triangles[:, [0, 1, 2, 0], :2]
    tree = shapely.STRtree(shapely.polygons(rings))
    centres = shapely.points(x, y)
    element, hit = tree.query(centres, predicate="intersects")
    a, b, c = (triangles[hit, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    rise_x = normal[:, 0] * (x[element] - a[:, 0])
    rise_y = normal[:, 1] * (y[element] - a[:, 1])
    height = a[:, 2] - (rise_x + rise_y) / normal[:, 2]
    return _Hits(element, numbers[hit], height)


def _side_of_use(crop: _Crop, hits: _Hits, layout: Layout, source: str) -> np.ndarray:
    """Mask (m,) of the faces of the use-face: one side of one body."""
    from trimesh.graph import connected_component_labels

    edges = crop.faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    body = connected_component_labels(edges, len(crop.points))
    side = 2 * body[crop.faces[:, 0]] + (crop.areas > 0)
    within = layout.in_square.ravel()[hits.element]
    side_hit, height = side[hits.face][within], hits.height[within]
    cover = np.bincount(side_hit)
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    heights = np.array([np.median(height[side_hit == one]) for one in candidates])
    nearest = np.argmin(np.abs(heights))
    use_side = candidates[nearest]
    apart = np.abs(heights - heights[nearest])
    is_alike = (candidates % 2 == use_side % 2) & (candidates != use_side)
    is_double = is_alike & (apart < _DOUBLE_MM)
    if is_double.any():
        _log.warning(
            "%s: the mesh has a second surface over the square, %.2g mm from the one used. "
            "If it was scanned twice, merge the two scans",
            source,
            apart[is_double].min(),
        )
    if use_side % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square point against the frame's normal",
            "Exchange points 2 and 3 of square.points_mm if they do not go anticlockwise as you "
            "look at the stone; if they do, turn the mesh's faces.",
        )
    return side == use_side


def _heights_met(
    crop: _Crop, hits: _Hits, is_own: np.ndarray, layout: Layout
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest and highest height of the use-face at each element (n, n), and the underside.

    The underside belongs to the body of the use-face. If this body has no underside, as when the
    two sides of a stone were not joined, any other body is used.
    """
    count = layout.in_square.size
    lowest, highest, below = (np.full(count, np.nan) for _ in range(3))
    element, face, height = hits
    own = is_own[face]
    np.fmin.at(lowest, element[own], height[own])
    np.fmax.at(highest, element[own], height[own])
    looks_down = crop.areas[face] < 0
    in_square = layout.in_square.ravel()[element]
    under = in_square & looks_down & (height < highest[element])
    same = under & np.isin(crop.bodies[face], crop.bodies[is_own])
    covered = len(np.unique(element[same]))
    if covered > _JOINED * layout.grid**2:
        under = same
    np.fmax.at(below, element[under], height[under])
    shape = layout.in_square.shape
    return lowest.reshape(shape), highest.reshape(shape), below.reshape(shape)


def _missed(
    mesh: "trimesh.Trimesh", frame: Frame, layout: Layout, source: str
) -> InputError:
    vertices = frame.to_frame(mesh.vertices)
    lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
    return InputError(
        source,
        f"no part of the mesh lies over the square: in the square's frame the mesh spans "
        f"x {lowest[0]:.4g} to {highest[0]:.4g} and y {lowest[1]:.4g} to {highest[1]:.4g} mm, "
        f"the square 0 to {layout.size_mm:g} mm",
        "Check inputs.mesh_unit and square.points_mm in the config.",
    )


def _check_folds(
    folded: np.ndarray, apart: np.ndarray, layout: Layout, source: str
) -> None:
    """Refuse a square in which more than specks have two heights, so far `apart`."""
    folded = folded & layout.in_square
    if folded.sum() > _FOLDED_FRACTION * layout.grid**2:
        raise InputError(
            source,
            f"the mesh folds over within the square: {layout.share_of_square(folded)} has two "
            f"heights, up to {apart[folded].max():.3g} mm apart",
            "Move square.points_mm so that the square faces the use-face squarely, or repair "
            "the mesh.",
        )
