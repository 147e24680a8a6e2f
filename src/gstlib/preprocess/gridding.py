"""From a stone's mesh to the heights of its use-face on a regular grid.

The cloud of vertices is cropped larger than the square and interpolated in the square's plane; then
the square is cut out. The paper interpolates linearly over the Delaunay triangulation (as MATLAB's
scatteredInterpolant does). Smoother interpolations are also tried, and left-out vertices show which
one predicts the stone best. First, the use-face is separated from the rest of the stone: the normal
through a point of the square meets a closed mesh twice, a hollow or damaged one more often.
"""

import logging
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.geometry import Frame
from gstlib.surface import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["grid_mesh", "gridding_table"]

_log = logging.getLogger(__name__)

# ASSUME: holes of the mesh up to this share of the square are pin-holes of the scanner. They are
# bridged by the interpolation, as the paper's would be.
_BRIDGED_SHARE = 1e-2
# ASSUME: overhangs up to this share of the square are specks of the scanner and are accepted.
_FOLDED_SHARE = 1e-3
# Heights of one element that differ by less (mm) count as one: the element lies on an edge.
_SAME_HEIGHT = 1e-6
# A face seen edge-on (area in mm²) covers nothing.
_EDGE_ON = 1e-12
# From the simplest to the smoothest.
_INTERPOLATIONS = ("linear", "clough-tocher", "cubic")
# Nearest vertices that the cubic radial basis uses for a point.
_NEIGHBOURS = 50
# Fewest vertices in the square: fewer say little about the errors between them.
_FEWEST = 30
# The vertices in the square are left out in so many random groups, one group at a time. If there
# are more vertices than this, every second or third is left out: a few thousand take a second.
_GROUPS, _SEED, _MOST_LEFT_OUT = 8, 1, 5000
# ASSUME: of the interpolations whose r.m.s. error on left-out vertices is within this share of the
# smallest, the simplest is the best.
_TIE = 0.01


def grid_mesh(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    shape: tuple[int, int],
    margin_mm: float,
    interpolation: str = "best",
    source: str = "mesh",
) -> xr.Dataset:
    """Heights of the use-face over the analysed square, and how well vertices predict each other.

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
    shape : (ny, nx)
        Elements of the grid.
    margin_mm : float
        How much larger than the square the cloud is cropped on every side.
    interpolation : {"linear", "clough-tocher", "cubic", "best"}
        Linear over the Delaunay triangulation; smooth over it (Clough-Tocher); a cubic radial basis
        of the 50 nearest vertices; or the one with the smallest error on left-out vertices.
    source : str
        Name of the mesh's file, for messages.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x) along the normal, mm, above the frame's origin, at the element centres of
        [0, size]²; its attributes ``mesh_points`` (number interpolated), ``mesh_edge_mm`` (mean
        edge length in the crop) and ``interpolation``. ``vertex_y, vertex_x`` (vertex), mm, of the
        vertices left out, and ``left_out_error`` (vertex), mm: height less its prediction from the
        others. ``left_out_rms`` (candidate), mm: the r.m.s. of these errors for each interpolation.

    Raises
    ------
    InputError
        The square misses the stone or sticks out of it, or contains fewer than 30 vertices; the
        mesh folds over within the square, or its faces point into the stone.
    """
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
    areas = 0.5 * (
        (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    )  # > 0: look up
    place, face, height = _ray_heights(points, faces, np.abs(areas) > _EDGE_ON, x, y)
    if len(face) == 0:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        raise InputError(
            source,
            f"no part of the mesh lies over the square: in the square's frame the mesh spans "
            f"x {low[0]:.4g} to {high[0]:.4g} and y {low[1]:.4g} to {high[1]:.4g} mm, the square "
            f"0 to {size_mm:g} mm",
            "Check inputs.mesh_unit and square.points_mm in the config.",
        )
    body = connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), len(points))
    side = 2 * body[faces[:, 0]] + (areas > 0)
    hit = side[face]
    cover = np.bincount(hit)
    # Specks, flaps and the inside of a hollow scan are no candidates.
    candidates = np.flatnonzero(cover >= 0.5 * cover.max())
    use_face = min(candidates, key=lambda one: abs(float(np.median(height[hit == one]))))
    if use_face % 2 == 0:
        raise InputError(
            source,
            "the mesh's faces over the square point against the frame's normal",
            "Exchange points 2 and 3 of square.points_mm if they do not go anticlockwise as you "
            "look at the stone; if they do, turn the mesh's faces.",
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
            "Move square.points_mm so that the square faces the use-face squarely, or repair "
            "the mesh.",
        )
    triangles = points[faces[side == use_face]]
    edge = float(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).mean())
    cloud = points[np.unique(faces[side == use_face])]
    inside = np.flatnonzero(((cloud[:, :2] >= 0) & (cloud[:, :2] <= size_mm)).all(axis=1))
    if len(inside) < _FEWEST:
        raise InputError(
            source,
            f"the mesh has {len(inside)} vertices in the square of {size_mm:g} mm, and at least "
            f"{_FEWEST} are needed",
            "Give a finer mesh, make square.size_mm larger, or check inputs.mesh_unit in the "
            "config.",
        )
    places = np.stack([x, y], axis=-1)
    heights = _predicted("linear", cloud, places)
    if np.isnan(heights).any() or bare.mean() > _BRIDGED_SHARE:
        raise InputError(
            source,
            f"the square sticks out of the mesh, or the mesh has a hole: there is no use-face in "
            f"{_describe(np.isnan(heights) | bare, x, y)}",
            "Move square.points_mm in the config, make square.size_mm smaller, check "
            "inputs.mesh_unit, or repair the mesh (holes, and faces turned inside out).",
        )
    if bare.any():
        _log.warning("holes of the mesh were bridged: %s", _describe(bare, x, y))
    vertex, errors = _left_out(cloud, inside)
    rms = np.sqrt((errors**2).mean(axis=1))
    best = int(np.argmax(rms <= (1 + _TIE) * rms.min()))
    chosen = best if interpolation == "best" else _INTERPOLATIONS.index(interpolation)
    if chosen:  # the linear heights exist already
        heights = _predicted(_INTERPOLATIONS[chosen], cloud, places)
    surface = make_surface(
        heights,
        [size_mm / count for count in shape],
        long_name="height of the use-face",
        mesh_points=len(cloud),
        mesh_edge_mm=edge,
        interpolation=_INTERPOLATIONS[chosen],
    )
    return xr.Dataset(
        {
            "height": surface,
            "vertex_y": ("vertex", cloud[vertex, 1], _in_mm("y of a left-out vertex")),
            "vertex_x": ("vertex", cloud[vertex, 0], _in_mm("x of a left-out vertex")),
            "left_out_error": ("vertex", errors[chosen], _in_mm("height less its prediction")),
            "left_out_rms": ("candidate", rms, _in_mm("r.m.s. error on left-out vertices")),
        },
        coords={"candidate": list(_INTERPOLATIONS)},
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


def _left_out(cloud: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (n,) of vertices left out, and each interpolation's errors (3, n) on them, mm."""
    inside = inside[:: 1 + len(inside) // _MOST_LEFT_OUT]
    group = np.random.default_rng(_SEED).permutation(len(inside)) % _GROUPS
    errors = np.empty((len(_INTERPOLATIONS), len(inside)))
    for out in (group == number for number in range(_GROUPS)):
        left, others = cloud[inside[out]], np.delete(cloud, inside[out], axis=0)
        for row, kind in zip(errors, _INTERPOLATIONS, strict=True):
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


def _describe(mask: np.ndarray, x: np.ndarray, y: np.ndarray) -> str:
    """How much of the square a mask covers, and where."""
    return (
        f"{100 * mask.mean():.3g} % of the square (x {x[mask].min():.3g} to {x[mask].max():.3g}, "
        f"y {y[mask].min():.3g} to {y[mask].max():.3g} mm)"
    )
