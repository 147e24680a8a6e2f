"""From a stone's mesh to the heights of its use-face on a regular grid.

As in the paper: the cloud of vertices is cropped larger than the square, interpolated linearly over
its Delaunay triangulation in the square's plane (what MATLAB's scatteredInterpolant does), and the
square is cut out after. Before it, the use-face is told from the rest of the stone, since a closed
mesh has two sheets over each x, y.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import ConfigError, InputError
from gstlib.surface import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Frame", "grid_mesh"]

_log = logging.getLogger(__name__)

# Axes typed with a few digits are perpendicular to within this cosine; beyond it one is wrong.
_PERPENDICULAR = 0.01
# A mesh whose faces' area vectors cancel to this share encloses a volume, pin-holes aside.
_CLOSED = 0.01
# Vertices closer than this (mm) are one: STL repeats them for every face.
_SAME_VERTEX = 1e-6
# ASSUME: holes of the mesh up to this share of the square are bridged by the interpolation, as the
# paper's would; they are pin-holes of the scanner.
_BRIDGED_SHARE = 1e-2
# ASSUME: overhangs up to this share of the square are specks of the scanner and let pass.
_FOLDED_SHARE = 1e-3


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


def grid_mesh(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    shape: tuple[int, int],
    margin_mm: float,
    source: str = "mesh",
) -> xr.DataArray:
    """Heights of the use-face over the analysed square.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm; closed, or an open sheet whose faces look out of the stone.
    frame : Frame
        The square's frame. Its origin need not touch the surface, but if several sheets look
        outwards over the square, the one nearest to its plane is the use-face.
    size_mm : float
        Side of the square.
    shape : (ny, nx)
        Elements of the grid.
    margin_mm : float
        How much larger than the square the cloud is cropped on every side.
    source : str
        Name of the mesh's file, for messages.

    Returns
    -------
    (ny, nx) xarray.DataArray
        Heights along the normal, mm, above the frame's origin, at the element centres of
        [0, size]²; attributes ``mesh_points`` (number interpolated) and ``mesh_edge_mm`` (mean edge
        length in the crop).

    Raises
    ------
    InputError
        The square misses the stone or sticks out of it, the mesh folds over within the square, or
        its faces look into the stone.
    """
    points = frame.to_frame(mesh.vertices)
    faces = np.asarray(mesh.faces)
    outwards = _orientation(points, faces)
    points, faces = _crop(points, faces, size_mm, margin_mm, source)
    up = outwards * _projected_areas(points, faces) > 0
    ny, nx = shape
    y, x = np.meshgrid(
        axis_coordinates(ny, size_mm / ny), axis_coordinates(nx, size_mm / nx), indexing="ij"
    )
    hits = _pierce(points, faces, x.ravel(), y.ravel())
    kept = up & _use_face(points, faces, up, hits, source)
    _check_single_valued(hits.keep(kept), x.ravel(), y.ravel(), source)
    used = points[np.unique(faces[kept])]
    heights = _interpolate(used, x, y)
    bare = hits.keep(kept).count(x.size).reshape(shape) == 0
    _check_coverage(np.isnan(heights), bare, x, y, source)
    return make_surface(
        heights,
        (size_mm / ny, size_mm / nx),
        long_name="height of the use-face",
        mesh_points=len(used),
        mesh_edge_mm=_mean_edge(points, faces[kept]),
    )


@dataclass(frozen=True)
class _Hits:
    """Where the normals through the element centres pierce faces: element, face, height (mm)."""

    element: np.ndarray
    face: np.ndarray
    height: np.ndarray

    def keep(self, faces: np.ndarray) -> "_Hits":
        """Those on the faces of a mask."""
        chosen = faces[self.face]
        return _Hits(self.element[chosen], self.face[chosen], self.height[chosen])

    def count(self, elements: int) -> np.ndarray:
        """Number of hits per element."""
        return np.bincount(self.element, minlength=elements)


def _orientation(points: np.ndarray, faces: np.ndarray) -> int:
    """+1, or -1 for a closed mesh that is inside out (negative volume)."""
    corners = points[faces] - points.mean(axis=0)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    closed = np.abs(areas.sum(axis=0)).max() < _CLOSED * np.linalg.norm(areas, axis=1).sum()
    if closed and np.einsum("ij,ij->", corners[:, 0], areas) < 0:
        _log.warning("the mesh is inside out (its volume is negative): its faces were turned")
        return -1
    return 1


def _crop(points, faces, size, margin, source) -> tuple[np.ndarray, np.ndarray]:
    """Faces whose bounding box meets the square and its margin, with equal vertices merged."""
    inside = np.ones(len(faces), dtype=bool)
    for axis in (0, 1):
        corners = points[:, axis][faces]
        inside &= (corners.min(axis=1) <= size + margin) & (corners.max(axis=1) >= -margin)
    if not inside.any():
        low, high = points.min(axis=0), points.max(axis=0)
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {low[0]:.4g} to {high[0]:.4g} and y {low[1]:.4g} to {high[1]:.4g} mm, the square "
            f"0 to {size:g} mm",
            "Check inputs.mesh_unit and square.frame in the config.",
        )
    used, local = np.unique(faces[inside], return_inverse=True)
    _, first, same = np.unique(
        np.round(points[used] / _SAME_VERTEX).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    return points[used][first], same.reshape(-1)[local].reshape(-1, 3)


def _projected_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Signed area (mm²) of each face seen along the normal: positive if it looks outwards."""
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _pierce(points: np.ndarray, faces: np.ndarray, x: np.ndarray, y: np.ndarray) -> _Hits:
    """All faces over and under each (x, y)."""
    import shapely

    # A face seen edge-on covers nothing.
    seen = np.flatnonzero(np.abs(_projected_areas(points, faces)) > 1e-12)
    triangles = points[faces[seen]]
    tree = shapely.STRtree(shapely.polygons(triangles[:, [0, 1, 2, 0], :2]))
    element, hit = tree.query(shapely.points(x, y), predicate="intersects")
    a, b, c = (triangles[hit, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    height = (
        a[:, 2]
        - (normal[:, 0] * (x[element] - a[:, 0]) + normal[:, 1] * (y[element] - a[:, 1]))
        / normal[:, 2]
    )
    return _Hits(element, seen[hit], height)


def _use_face(points, faces, up, hits: _Hits, source) -> np.ndarray:
    """Mask of the faces of the body that the use-face is part of.

    A body is what hangs together within the crop; each has a side that looks outwards and one that
    looks away. The use-face is, of the sides that cover most of the square, the nearest to its
    plane.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    tails, heads = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    graph = coo_array((np.ones(len(tails), bool), (tails, heads)), shape=2 * [len(points)])
    _, labels = connected_components(graph, directed=False)
    body = labels[faces[:, 0]]
    if len(hits.face) == 0:
        raise InputError(
            source,
            f"the mesh does not reach into the square: what lies near it is "
            f"{np.ptp(points[:, :2], axis=0).max():.4g} mm wide",
            "Check inputs.mesh_unit and square.frame in the config.",
        )
    side = 2 * body[hits.face] + up[hits.face]
    cover = np.bincount(side)
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    distance = [abs(float(np.median(hits.height[side == index]))) for index in candidates]
    nearest = int(candidates[int(np.argmin(distance))])
    if nearest % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square look against the frame's normal",
            "Turn square.frame.normal in the config if it points into the stone; else turn the "
            "mesh's faces.",
        )
    return body == nearest // 2


def _check_single_valued(hits: _Hits, x, y, source) -> None:
    """Refuse a use-face that folds over: several heights at one element."""
    low = np.full(x.size, np.inf)
    high = np.full(x.size, -np.inf)
    np.minimum.at(low, hits.element, hits.height)
    np.maximum.at(high, hits.element, hits.height)
    step = np.where(np.isfinite(low), high - low, 0.0)
    folded = step > _SAME_VERTEX
    if folded.sum() > _FOLDED_SHARE * x.size:
        raise InputError(
            source,
            f"the mesh folds over within the square: {_describe(folded, x, y)} has two heights, "
            f"up to {step.max():.3g} mm apart",
            "Turn square.frame so that it looks at the use-face squarely, move it, or repair the "
            "mesh.",
        )
    if folded.any():
        _log.warning("the mesh folds over in specks: %s", _describe(folded, x, y))


def _interpolate(points: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Linear interpolation of scattered heights at (x, y), NaN outside their hull."""
    from scipy.interpolate import LinearNDInterpolator

    return LinearNDInterpolator(points[:, :2], points[:, 2])(x, y)


def _check_coverage(outside, bare, x, y, source) -> None:
    """Refuse a square that sticks out of the mesh (NaN) or lies over a large hole of it."""
    if outside.any() or bare.mean() > _BRIDGED_SHARE:
        missing = outside | bare
        raise InputError(
            source,
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{_describe(missing, x, y)}",
            "Move square.frame in the config, make square.size_mm smaller, or repair the mesh.",
        )
    if bare.any():
        _log.warning("holes of the mesh were bridged: %s", _describe(bare, x, y))


def _describe(mask: np.ndarray, x: np.ndarray, y: np.ndarray) -> str:
    """How much of the square a mask is, and where."""
    return (
        f"{100 * mask.mean():.3g} % of the square (x {x[mask].min():.3g} to {x[mask].max():.3g}, "
        f"y {y[mask].min():.3g} to {y[mask].max():.3g} mm)"
    )


def _mean_edge(points: np.ndarray, faces: np.ndarray) -> float:
    """Mean length (mm) of the faces' edges."""
    corners = points[faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())
