"""From a stone's mesh to the heights of its use-face on a regular grid.

As in the paper: the cloud of vertices is cropped larger than the square and interpolated linearly
over its Delaunay triangulation in the square's plane (MATLAB's scatteredInterpolant does the same);
then the square is cut out. Before that, the use-face is told from the rest of the stone: the normal
through a point of the square meets a closed mesh twice, a hollow or damaged one more often.
"""

import logging
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.preprocess.frame import Frame
from gstlib.surface import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["grid_mesh"]

_log = logging.getLogger(__name__)

# ASSUME: holes of the mesh up to this share of the square are pin-holes of the scanner. They are
# bridged by the interpolation, as the paper's would be.
_BRIDGED_SHARE = 1e-2
# ASSUME: overhangs up to this share of the square are specks of the scanner and are accepted.
_FOLDED_SHARE = 1e-3
# Heights of one element that differ by less (mm) are one: the element lies on an edge.
_SAME_HEIGHT = 1e-6
# A mesh whose area vectors cancel to this share is closed, but for pin-holes: scanners leave some.
_CLOSED = 0.01
# A face seen edge-on (area in mm²) covers nothing.
_EDGE_ON = 1e-12


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

    The faces near the square fall into bodies that hang together, each with an upper and a lower
    side. Of the sides that cover most of the square, the use-face is the nearest to its plane.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm, its equal vertices merged; closed, or an open sheet whose faces look out of
        the stone. A closed one that is inside out is turned.
    frame : Frame
        The square's frame. Its origin need not touch the surface.
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
    from scipy.interpolate import LinearNDInterpolator
    from trimesh.graph import connected_component_labels

    vertices = frame.to_frame(mesh.vertices)
    corners = vertices[:, :2][mesh.faces]
    near = (corners.min(axis=1) <= size_mm + margin_mm) & (corners.max(axis=1) >= -margin_mm)
    used, inverse = np.unique(mesh.faces[near.all(axis=1)], return_inverse=True)
    points, faces = vertices[used], inverse.reshape(-1, 3)
    y, x = np.meshgrid(
        *(axis_coordinates(count, size_mm / count) for count in shape), indexing="ij"
    )
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    areas = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])  # > 0: look up
    place, face, height = _ray_heights(points, faces, np.abs(areas) > _EDGE_ON, x, y)
    if len(face) == 0:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {low[0]:.4g} to {high[0]:.4g} and y {low[1]:.4g} to {high[1]:.4g} mm, the square "
            f"0 to {size_mm:g} mm",
            "Check inputs.mesh_unit and square.frame in the config.",
        )
    body = connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), len(points))
    side = 2 * body[faces[:, 0]] + (_orientation(mesh) * areas > 0)
    hit = side[face]
    cover = np.bincount(hit)
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    use_face = min(candidates, key=lambda one: abs(float(np.median(height[hit == one]))))
    if use_face % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square look against the frame's normal",
            "If square.frame's normal points into the stone, turn it, or exchange points 2 and 3 "
            "of points_mm (they turn anticlockwise as one looks at the stone); if not, turn the "
            "mesh's faces.",
        )
    place, height = place[hit == use_face], height[hit == use_face]
    lowest, highest = np.full(shape, np.nan), np.full(shape, np.nan)
    np.fmin.at(lowest.reshape(-1), place, height)
    np.fmax.at(highest.reshape(-1), place, height)
    folded, bare = highest - lowest > _SAME_HEIGHT, np.isnan(highest)
    if folded.mean() > _FOLDED_SHARE:
        raise InputError(
            source,
            f"the mesh folds over within the square: {_describe(folded, x, y)} has two heights, "
            f"up to {np.nanmax(highest - lowest):.3g} mm apart",
            "Turn square.frame so that it looks at the use-face squarely, move it, or repair the "
            "mesh.",
        )
    cloud = points[np.unique(faces[side == use_face])]
    heights = LinearNDInterpolator(cloud[:, :2], cloud[:, 2])(x, y)
    if np.isnan(heights).any() or bare.mean() > _BRIDGED_SHARE:
        raise InputError(
            source,
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{_describe(np.isnan(heights) | bare, x, y)}",
            "Move square.frame in the config, make square.size_mm smaller, check inputs.mesh_unit, "
            "or repair the mesh (holes, and faces turned inside out).",
        )
    if bare.any():
        _log.warning("holes of the mesh were bridged: %s", _describe(bare, x, y))
    triangles = points[faces[side == use_face]]
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    return make_surface(
        heights,
        [size_mm / count for count in shape],
        long_name="height of the use-face",
        mesh_points=len(cloud),
        mesh_edge_mm=float(edges.mean()),
    )


def _orientation(mesh: "trimesh.Trimesh") -> int:
    """+1, or -1 for a closed mesh that is inside out (negative volume)."""
    areas = mesh.triangles_cross
    closed = np.abs(areas.sum(axis=0)).max() < _CLOSED * np.linalg.norm(areas, axis=1).sum()
    # from its middle, so that pin-holes far from the origin count little
    if closed and ((mesh.triangles_center - mesh.bounds.mean(axis=0)) * areas).sum() < 0:
        _log.warning("the mesh is inside out (its volume is negative): its faces were turned")
        return -1
    return 1


def _ray_heights(
    points: np.ndarray, faces: np.ndarray, seen: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where normals through (x, y) meet the faces `seen`: place, face and z (mm) of each hit."""
    # trimesh's rays miss hits on shared edges or count them twice, and need packages of their own.
    import shapely

    x, y, numbers = x.ravel(), y.ravel(), np.flatnonzero(seen)
    triangles = points[faces[numbers]]
    tree = shapely.STRtree(shapely.polygons(triangles[:, [0, 1, 2, 0], :2]))
    place, hit = tree.query(shapely.points(x, y), predicate="intersects")
    a, b, c = (triangles[hit, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    rise = normal[:, 0] * (x[place] - a[:, 0]) + normal[:, 1] * (y[place] - a[:, 1])
    return place, numbers[hit], a[:, 2] - rise / normal[:, 2]


def _describe(mask: np.ndarray, x: np.ndarray, y: np.ndarray) -> str:
    """How much of the square a mask is, and where."""
    return (
        f"{100 * mask.mean():.3g} % of the square (x {x[mask].min():.3g} to {x[mask].max():.3g}, "
        f"y {y[mask].min():.3g} to {y[mask].max():.3g} mm)"
    )
