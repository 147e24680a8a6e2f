"""From a stone's mesh to the heights of its use-face on a regular grid.

The cloud of vertices is cropped larger than the grid and interpolated in the square's plane. The
grid covers the square and, if asked for, the face around it, as far as there is stone. The paper
interpolates linearly over the Delaunay triangulation (as MATLAB's scatteredInterpolant does).
Smoother interpolations are also tried, and left-out vertices show which one predicts the stone
best. First, the use-face is separated from the rest of the stone: the normal through a point of the
square meets a closed mesh twice, a hollow or damaged one more often.
"""

import logging
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["elements_around", "grid_mesh", "gridding_table"]

_log = logging.getLogger(__name__)

# ASSUME: holes of the mesh up to this share of the square are pin-holes of the scanner. They are
# bridged by the interpolation, as the paper's would be.
_BRIDGED_FRACTION = 1e-2
# ASSUME: beyond the square, what the mesh does not show or shows twice is no stone: the use-face
# ends or turns away there. In the square it is a fault.
# ASSUME: overhangs up to this share of the square are specks of the scanner and are accepted.
_FOLDED_FRACTION = 1e-3
# Heights of one element that differ by less (mm) count as one: the element lies on an edge.
_SAME_HEIGHT = 1e-6
# A face seen edge-on (area in mm²) covers nothing.
_EDGE_ON = 1e-12
# From the simplest to the smoothest.
_INTERPOLATIONS = ("linear", "clough-tocher", "cubic")
# Nearest vertices that the cubic radial basis uses for a point.
_NEIGHBOURS = 50
# It takes 0.1 ms for a point, and between vertices it is smooth: so many points an edge hold it.
_POINTS_PER_EDGE = 3
# How far beyond the grid the cloud is cropped: the paper says "bigger than the square".
_MARGIN_MM = 1.0
# Fewest vertices in the square: fewer say little about the errors between them.
_FEWEST = 30
# The vertices in the square are left out in so many random groups, one group at a time. If there
# are more vertices than this, every second or third is left out: a few thousand take a second.
_GROUPS, _SEED, _MOST_LEFT_OUT = 8, 1, 5000
# ASSUME: of the interpolations whose r.m.s. error on left-out vertices is within this share of the
# smallest, the simplest is the best.
_TIE = 0.01


def elements_around(size_mm: float, grid: int, face_mm: float | None) -> int:
    """Elements of a face of this side on every side of its square; none without a larger face."""
    return 0 if face_mm is None else max(0, round((face_mm / size_mm - 1) * grid / 2))


def grid_mesh(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    grid: int,
    around: int = 0,
    interpolation: str = "best",
    source: str = "mesh",
) -> xr.Dataset:
    """Heights of the use-face over the analysed square and around it; how well vertices agree.

    The faces near the square form connected bodies, each with an upper and a lower side. Of the
    sides that cover most of the square, the use-face is the one nearest to its plane.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm, with equal vertices merged and faces pointing outwards, as from
        `gstlib.io.meshes.read_mesh`.
    frame : Frame
        The square's frame. Its origin need not touch the surface.
    size_mm : float
        Side of the square.
    grid : int
        Elements along it.
    around : int
        Elements of the face on every side of the square.
    interpolation : {"linear", "clough-tocher", "cubic", "best"}
        Linear over the Delaunay triangulation; smooth over it (Clough-Tocher); a cubic radial basis
        of the 50 nearest vertices; or the one with the smallest error on left-out vertices.
    source : str
        Name of the mesh's file, for messages.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x) along the normal, mm, above the frame's origin, at the element centres of
        the face, the square's from 0 to `size_mm`; NaN where there is no stone. Its attributes
        ``mesh_points`` (number interpolated), ``mesh_edge_mm`` (mean edge length in the crop),
        ``interpolation``, and ``thickness_mm``, the stone's least under the square (NaN for a mesh
        without an underside). ``vertex_y, vertex_x`` (vertex), mm, of the vertices left out, and
        ``left_out_error`` (vertex), mm: height less its prediction from the others.
        ``left_out_rms`` (candidate), mm: the r.m.s. of these errors for each interpolation tried.

    Raises
    ------
    InputError
        The square misses the stone or sticks out of it, or contains fewer than 30 vertices; the
        mesh folds over within the square, or its faces point into the stone.
    """
    from trimesh.graph import connected_component_labels

    element = size_mm / grid
    low, high = -around * element, size_mm + around * element
    along = axis_coordinates(grid + 2 * around, element) + low
    y, x = np.meshgrid(along, along, indexing="ij")
    of_square = np.zeros(y.shape, bool)
    of_square[around : around + grid, around : around + grid] = True
    vertices = frame.to_frame(mesh.vertices)
    corners = vertices[:, :2][mesh.faces]
    near = (corners.min(axis=1) <= high + _MARGIN_MM) & (
        corners.max(axis=1) >= low - _MARGIN_MM
    )
    used, inverse = np.unique(mesh.faces[near.all(axis=1)], return_inverse=True)
    points, faces = vertices[used], inverse.reshape(-1, 3)
    a, b, c = (points[faces[:, k], :2] for k in range(3))
    areas = 0.5 * (
        (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    )  # > 0: look up
    place, face, height = _ray_heights(points, faces, np.abs(areas) > _EDGE_ON, x, y)
    within = of_square.ravel()[place]
    if not within.any():
        lowest, highest = vertices.min(axis=0), vertices.max(axis=0)
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {lowest[0]:.4g} to {highest[0]:.4g} and y {lowest[1]:.4g} to {highest[1]:.4g} mm, "
            f"the square 0 to {size_mm:g} mm",
            "Check inputs.mesh_unit and square.points_mm in the config.",
        )
    body = connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), len(points))
    side = 2 * body[faces[:, 0]] + (areas > 0)
    hit = side[face]
    cover = np.bincount(hit[within])
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    use_face = min(
        candidates, key=lambda one: abs(float(np.median(height[within & (hit == one)])))
    )
    if use_face % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square point against the frame's normal",
            "Exchange points 2 and 3 of square.points_mm if they do not go anticlockwise as you "
            "look at the stone; if they do, turn the mesh's faces.",
        )
    lowest, highest, below = (np.full(y.shape, np.nan) for _ in range(3))
    own = hit == use_face
    np.fmin.at(lowest.reshape(-1), place[own], height[own])
    np.fmax.at(highest.reshape(-1), place[own], height[own])
    under = within & (areas[face] < 0) & (height < highest.reshape(-1)[place])
    np.fmax.at(below.reshape(-1), place[under], height[under])
    folded, bare = highest - lowest > _SAME_HEIGHT, np.isnan(highest)
    ends = (folded | bare) & ~of_square
    folded, bare = folded & of_square, bare & of_square
    if folded.sum() > _FOLDED_FRACTION * grid**2:
        raise InputError(
            source,
            f"the mesh folds over within the square: {_describe(folded, of_square, x, y)} has two "
            f"heights, up to {(highest - lowest)[folded].max():.3g} mm apart",
            "Move square.points_mm so that the square faces the use-face squarely, or repair "
            "the mesh.",
        )
    triangles = points[faces[side == use_face]]
    edge = float(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).mean())
    cloud = points[np.unique(faces[side == use_face])]
    gridded = ((cloud[:, :2] >= low) & (cloud[:, :2] <= high)).all(axis=1)
    in_square = ((cloud[:, :2] >= 0) & (cloud[:, :2] <= size_mm)).all(axis=1)
    if (count := int(in_square.sum())) < _FEWEST:
        raise InputError(
            source,
            f"the mesh has {count} vertices in the square of {size_mm:g} mm, and at least "
            f"{_FEWEST} are needed",
            "Give a finer mesh, make square.size_mm larger, or check inputs.mesh_unit in the "
            "config.",
        )
    heights = _gridded("linear", cloud, along, edge)
    missing = (np.isnan(heights) | bare) & of_square
    if np.isnan(heights[of_square]).any() or bare.sum() > _BRIDGED_FRACTION * grid**2:
        raise InputError(
            source,
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{_describe(missing, of_square, x, y)}",
            "Move square.points_mm in the config, make square.size_mm smaller, check "
            "inputs.mesh_unit, or repair the mesh (holes, and faces turned inside out).",
        )
    if bare.any():
        _log.warning("holes of the mesh were bridged: %s", _describe(bare, of_square, x, y))
    tried = _INTERPOLATIONS if interpolation == "best" else (interpolation,)
    vertex, errors = _left_out(cloud, np.flatnonzero(gridded), tried)
    rms = np.sqrt((errors**2).mean(axis=1))
    best = int(np.argmax(rms <= (1 + _TIE) * rms.min()))
    chosen = tried[best]
    if chosen != "linear":  # the linear heights exist already
        smooth = _gridded(chosen, cloud, along, edge)
        heights = np.where(np.isnan(heights), np.nan, smooth)
    thickness = (highest - below)[of_square]
    surface = make_surface(
        np.where(ends, np.nan, heights),
        element,
        long_name="height of the use-face",
        mesh_points=len(cloud),
        mesh_edge_mm=edge,
        interpolation=chosen,
        thickness_mm=float(np.fmin.reduce(thickness)),
    )
    surface = surface.assign_coords(
        {axis: surface[axis].copy(data=along) for axis in surface.dims}
    )
    return xr.Dataset(
        {
            "height": surface,
            "vertex_y": ("vertex", cloud[vertex, 1], _in_mm("y of a left-out vertex")),
            "vertex_x": ("vertex", cloud[vertex, 0], _in_mm("x of a left-out vertex")),
            "left_out_error": ("vertex", errors[best], _in_mm("height less its prediction")),
            "left_out_rms": ("candidate", rms, _in_mm("r.m.s. error on left-out vertices")),
        },
        coords={"candidate": list(tried)},
    )


def gridding_table(square: xr.Dataset) -> pd.DataFrame:
    """How well each interpolation predicts vertices left out of the mesh, and which was chosen.

    The result has ``interpolation, left_out_rms_um, chosen``.
    """
    return pd.DataFrame(
        {
            "interpolation": square.candidate.values,
            "left_out_rms_um": 1e3 * square.left_out_rms.values,
            "chosen": square.candidate.values == square.height.attrs["interpolation"],
        }
    )


def _in_mm(long_name: str) -> dict[str, str]:
    return {"units": "mm", "long_name": long_name}


def _predicted(interpolation: str, cloud: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Heights (mm) at `places` (..., 2) from a cloud (n, 3); infinite where a cubic is impossible.

    Outside the cloud, all but the cubic are NaN.
    """
    points, heights = cloud[:, :2], cloud[:, 2]
    if interpolation == "linear":
        return scipy.interpolate.LinearNDInterpolator(points, heights)(places)
    if interpolation == "clough-tocher":
        return scipy.interpolate.CloughTocher2DInterpolator(points, heights)(places)
    spline = scipy.interpolate.RBFInterpolator(
        points, heights, neighbors=min(_NEIGHBOURS, len(cloud)), kernel="cubic", degree=2
    )
    try:
        return spline(places.reshape(-1, 2)).reshape(places.shape[:-1])
    except np.linalg.LinAlgError:  # neighbours in line
        return np.full(places.shape[:-1], np.inf)


def _gridded(
    interpolation: str, cloud: np.ndarray, along: np.ndarray, edge: float
) -> np.ndarray:
    """Heights (n, n), mm, at places `along` (n,) both axes; `edge` is the mean one of the mesh."""
    element = along[1] - along[0]
    wide = edge / _POINTS_PER_EDGE
    if interpolation != "cubic" or wide <= element:
        return _predicted(interpolation, cloud, _places(along))
    count = int(np.ceil((along[-1] - along[0]) / wide)) + 1
    nodes = np.linspace(along[0], along[-1], max(count, 4))
    coarse = _predicted(interpolation, cloud, _places(nodes))
    return scipy.interpolate.RectBivariateSpline(nodes, nodes, coarse)(along, along)


def _places(along: np.ndarray) -> np.ndarray:
    """Places (n, n, 2), x and y, of a grid."""
    y, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x, y], axis=-1)


def _left_out(
    cloud: np.ndarray, inside: np.ndarray, tried: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) of vertices left out, and errors (k, n) on them of those tried, mm."""
    inside = inside[:: 1 + len(inside) // _MOST_LEFT_OUT]
    group = np.random.default_rng(_SEED).permutation(len(inside)) % _GROUPS
    errors = np.empty((len(tried), len(inside)))
    for out in (group == number for number in range(_GROUPS)):
        left, others = cloud[inside[out]], np.delete(cloud, inside[out], axis=0)
        for row, kind in zip(errors, tried, strict=True):
            row[out] = left[:, 2] - _predicted(kind, others, left[:, :2])
    known = ~np.isnan(errors).any(axis=0)
    return inside[known], errors[:, known]


def _ray_heights(
    points: np.ndarray, faces: np.ndarray, seen: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where normals through (x, y) meet the faces `seen`: place, face and z (mm) of each hit."""
    # trimesh's rays miss hits on shared edges or count them twice, and need further packages.
    import shapely

    x, y, numbers = x.ravel(), y.ravel(), np.flatnonzero(seen)
    triangles = points[faces[numbers]]
    tree = shapely.STRtree(shapely.polygons(triangles[:, [0, 1, 2, 0], :2]))
    place, hit = tree.query(shapely.points(x, y), predicate="intersects")
    a, b, c = (triangles[hit, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    rise = normal[:, 0] * (x[place] - a[:, 0]) + normal[:, 1] * (y[place] - a[:, 1])
    return place, numbers[hit], a[:, 2] - rise / normal[:, 2]


def _describe(mask: np.ndarray, square: np.ndarray, x: np.ndarray, y: np.ndarray) -> str:
    """How much of the square a mask covers, and where."""
    x, y = x[mask], y[mask]
    return (
        f"{100 * mask[square].mean():.3g} % of the square (x {x.min():.3g} to {x.max():.3g}, "
        f"y {y.min():.3g} to {y.max():.3g} mm)"
    )
