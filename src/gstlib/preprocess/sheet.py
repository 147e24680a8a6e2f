"""Which faces of a stone lie over the analysed square, and which of them are its use-face.

A closed mesh has two sheets over each x, y of the square, a hollow or damaged one more. All here is
in the square's frame: z along the normal, out of the stone; the square is [0, size]² at z = 0.
"""

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gstlib.errors import InputError

if TYPE_CHECKING:
    import trimesh

__all__ = ["SAME_VERTEX", "Crop", "Hits", "crop_mesh", "find_use_face", "pierce"]

_log = logging.getLogger(__name__)

# Vertices closer than this (mm) are one: STL repeats them for every face.
SAME_VERTEX = 1e-6
# A mesh whose faces' area vectors cancel to this share encloses a volume, pin-holes aside.
_CLOSED = 0.01


@dataclass(frozen=True)
class Crop:
    """The faces over and under the square and its margin.

    Attributes
    ----------
    points : (n, 3) numpy.ndarray
        Their corners in the square's frame (mm), equal ones merged.
    faces : (m, 3) numpy.ndarray of int
        Their corners' places in `points`.
    up : (m,) numpy.ndarray of bool
        Whether the outer side of a face is seen from above.
    """

    points: np.ndarray
    faces: np.ndarray
    up: np.ndarray


@dataclass(frozen=True)
class Hits:
    """Where the normals through places of the square pierce faces.

    Attributes
    ----------
    element, face : (k,) numpy.ndarray of int
        Place, and face of the crop.
    height : (k,) numpy.ndarray
        z, mm.
    """

    element: np.ndarray
    face: np.ndarray
    height: np.ndarray

    def keep(self, faces: np.ndarray) -> "Hits":
        """Those on the faces of a mask."""
        chosen = faces[self.face]
        return Hits(self.element[chosen], self.face[chosen], self.height[chosen])

    def highest(self, elements: int) -> np.ndarray:
        """Highest z of each of so many places, -inf where nothing is hit."""
        heights = np.full(elements, -np.inf)
        np.maximum.at(heights, self.element, self.height)
        return heights

    def lowest(self, elements: int) -> np.ndarray:
        """Lowest z of each of so many places, inf where nothing is hit."""
        heights = np.full(elements, np.inf)
        np.minimum.at(heights, self.element, self.height)
        return heights


def crop_mesh(
    mesh: "trimesh.Trimesh", points: np.ndarray, *, size_mm: float, margin_mm: float, source: str
) -> Crop:
    """The faces whose bounding box meets the square and its margin.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone; a closed one that is inside out is turned.
    points : (n, 3) numpy.ndarray
        Its vertices in the square's frame, mm.
    size_mm, margin_mm : float
        Side of the square, and how far beyond it faces are taken.
    source : str
        Name of the mesh's file, for messages.

    Raises
    ------
    InputError
        There are none.
    """
    faces = np.asarray(mesh.faces)
    outwards = _orientation(points, faces)
    inside = np.ones(len(faces), dtype=bool)
    for axis in (0, 1):
        corners = points[:, axis][faces]
        inside &= corners.min(axis=1) <= size_mm + margin_mm
        inside &= corners.max(axis=1) >= -margin_mm
    if not inside.any():
        low, high = points.min(axis=0), points.max(axis=0)
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {low[0]:.4g} to {high[0]:.4g} and y {low[1]:.4g} to {high[1]:.4g} mm, the square "
            f"0 to {size_mm:g} mm",
            "Check inputs.mesh_unit and square.frame in the config.",
        )
    used, local = np.unique(faces[inside], return_inverse=True)
    _, first, same = np.unique(
        np.round(points[used] / SAME_VERTEX).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    points = points[used][first]
    faces = same.reshape(-1)[local].reshape(-1, 3)
    return Crop(points, faces, outwards * _projected_areas(points, faces) > 0)


def _orientation(points: np.ndarray, faces: np.ndarray) -> int:
    """+1, or -1 for a closed mesh that is inside out (negative volume)."""
    corners = points[faces] - points.mean(axis=0)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    closed = np.abs(areas.sum(axis=0)).max() < _CLOSED * np.linalg.norm(areas, axis=1).sum()
    if closed and np.einsum("ij,ij->", corners[:, 0], areas) < 0:
        _log.warning("the mesh is inside out (its volume is negative): its faces were turned")
        return -1
    return 1


def _projected_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Signed area (mm²) of each face seen along the normal: positive if it looks up."""
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def pierce(crop: Crop, x: np.ndarray, y: np.ndarray) -> Hits:
    """All faces over and under each (x, y)."""
    import shapely

    # A face seen edge-on covers nothing.
    seen = np.flatnonzero(np.abs(_projected_areas(crop.points, crop.faces)) > 1e-12)
    triangles = crop.points[crop.faces[seen]]
    tree = shapely.STRtree(shapely.polygons(triangles[:, [0, 1, 2, 0], :2]))
    element, hit = tree.query(shapely.points(x, y), predicate="intersects")
    a, b, c = (triangles[hit, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    height = (
        a[:, 2]
        - (normal[:, 0] * (x[element] - a[:, 0]) + normal[:, 1] * (y[element] - a[:, 1]))
        / normal[:, 2]
    )
    return Hits(element, seen[hit], height)


def find_use_face(crop: Crop, hits: Hits, source: str) -> tuple[np.ndarray, bool]:
    """The body that the use-face is part of, and whether it is seen from outside.

    A body is what hangs together within the crop; each has a side that looks up and one that looks
    down. The use-face is, of the sides that cover most of the square, the nearest to its plane.

    Returns
    -------
    body : (m,) numpy.ndarray of bool
        The faces of the body.
    up : bool
        Whether the use-face is its upper side.

    Raises
    ------
    InputError
        There is nothing over the square.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    points, faces = crop.points, crop.faces
    if len(hits.face) == 0:
        raise InputError(
            source,
            f"the mesh does not reach into the square: what lies near it is "
            f"{np.ptp(points[:, :2], axis=0).max():.4g} mm wide",
            "Check inputs.mesh_unit and square.frame in the config.",
        )
    tails, heads = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    graph = coo_array((np.ones(len(tails), bool), (tails, heads)), shape=2 * [len(points)])
    _, labels = connected_components(graph, directed=False)
    body = labels[faces[:, 0]]
    side = 2 * body[hits.face] + crop.up[hits.face]
    cover = np.bincount(side)
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    distance = [abs(float(np.median(hits.height[side == index]))) for index in candidates]
    nearest = int(candidates[int(np.argmin(distance))])
    return body == nearest // 2, bool(nearest % 2)
