"""Search of an overview map, or of scans that the stage ties together, on the mesh of a stone.

The stone is viewed from two opposite sides, as it rests when it is put down; then, if nothing is
found, from the other four. Each match is refined on shorter elements, with the mesh as
seen straight from above.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
import xarray as xr

from gst.check.matching import Match, match_map, match_together
from gst.check.sliding import sides_of
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import axis_coordinates, make_surface

if TYPE_CHECKING:
    import trimesh


# A face of the mesh is seen if its normal is turned by less than some 70° from the view.
_SEEN = 0.3
# Elements an edge of the mesh, in a view of the whole stone and from straight above.
_WHOLE, _CLOSE = 2, 4
# What is farther than so many edges from all vertices is no stone.
_GAP = 2.0
# How far around the scans (mm) the mesh is looked at from straight above.
_MARGIN = 1.5


class OnStone(NamedTuple):
    """Position of scans on a stone.

    `match` belongs to their common point in `frame`, whose x runs as their x does, or against it if
    they are mirrored. `reading` is the reading of the stage.
    """

    frame: Frame
    match: Match
    reading: int


def find_on_stone(
    mesh: "trimesh.Trimesh", scans: Sequence[xr.DataArray], readings: np.ndarray
) -> OnStone | None:
    """Find scans whose distances are known on a whole stone.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm.
    scans, readings
        As in `gst.check.matching.match_together`; of an overview, itself and zeros.

    Returns
    -------
    OnStone or None
        Its match may not count as found, and then shows how near it came; None if the scans
        are too small for the mesh, or larger than the stone.
    """
    edge, best = float(mesh.edges_unique_length.mean()), None
    # of several scans, a view takes many times as long
    for pair in itertools.islice(_views(mesh), 3 if len(scans) == 1 else 1):
        seen = []
        for frame, side in pair:
            view = view_of(mesh, frame, size_mm=side, step=edge / _WHOLE)
            try:
                seen.append((frame, *match_together(view, scans, readings)))
            except ValueError:
                continue
        for frame, match, reading in seen:
            others = [other.correlation for at, other, _ in seen if at is not frame]
            candidate = OnStone(frame, match.among(others, len(scans)), reading)
            if best is None or candidate.match.lead > best.match.lead:
                best = candidate
        if best is not None and best.match.is_found:
            return _from_above(mesh, best, scans, readings)
    return best


def _views(mesh: "trimesh.Trimesh") -> Iterator[list[tuple[Frame, float]]]:
    """Frames (and sides, mm) from which a whole stone is seen, in opposite pairs."""
    points = np.asarray(mesh.vertices)
    axes = np.linalg.eigh(np.cov(points, rowvar=False))[1].T  # the thinnest first
    for n in range(3):
        pair, x_axis = [], axes[(n + 1) % 3]
        for normal in (axes[n], -axes[n]):
            towards = np.array([x_axis, np.cross(normal, x_axis)])
            along = points @ towards.T
            low, high = along.min(axis=0), along.max(axis=0)
            corner = low @ towards + (points @ normal).mean() * normal
            side = float((high - low).max())
            pair.append((Frame(corner, x_axis, normal), side))
        yield pair


def view_of(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    *,
    size_mm: float,
    step: float | None = None,
    around_mm: float = 0.0,
) -> xr.DataArray:
    """Heights (y, x) of a stone as it is seen along a frame's normal, NaN beside it, mm.

    `size_mm` is the side of a square at the frame's origin, of which the view shows `around_mm`
    more on every side, and `step` is the side of its elements, by default a quarter of the mesh's
    edges. Parts that hide behind others are not treated separately: maps are matched with the view.
    """
    edge = float(mesh.edges_unique_length.mean())
    step = edge / _CLOSE if step is None else step
    points = frame.to_frame(mesh.vertices) + np.array([around_mm, around_mm, 0.0])
    size_mm += 2 * around_mm
    is_seen = np.asarray(mesh.vertex_normals) @ frame.axes[2] > _SEEN
    places, gap = points[:, :2], _GAP * edge
    is_near = ((places > -gap) & (places < size_mm + gap)).all(axis=1)
    cloud = points[is_seen & is_near]
    along = axis_coordinates(max(2, round(size_mm / step)), step)
    heights = np.full(2 * along.shape, np.nan)
    if len(cloud) > 3:
        y, x = np.meshgrid(along, along, indexing="ij")
        places = np.stack([x, y], axis=-1)
        tree = scipy.spatial.KDTree(cloud[:, :2])
        away, _ = tree.query(places, distance_upper_bound=gap)
        is_stone = np.isfinite(away)
        # straight lines between vertices would cut the shortest waves that the mesh has
        smooth = scipy.interpolate.CloughTocher2DInterpolator(cloud[:, :2], cloud[:, 2])
        heights[is_stone] = smooth(places[is_stone])
    view = make_surface(heights, step, mesh_edge_mm=edge)
    for axis in ("y", "x"):
        view[axis] = view[axis].copy(data=view[axis] - around_mm)
    is_stone = np.isfinite(heights)
    rows = np.flatnonzero(is_stone.any(axis=1))
    columns = np.flatnonzero(is_stone.any(axis=0))
    if len(rows) == 0:
        return view
    return view[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]


def _from_above(
    mesh: "trimesh.Trimesh",
    first: OnStone,
    scans: Sequence[xr.DataArray],
    readings: np.ndarray,
) -> OnStone:
    """The same scans on the mesh as it looks from straight above where they were found."""
    reading = readings[first.reading]
    diagonal = max(np.hypot(*sides_of(scan)) for scan in scans)
    half = float(np.ptp(reading, axis=0).max()) / 2 + diagonal / 2 + _MARGIN
    middle = (reading.min(axis=0) + reading.max(axis=0)) / 2
    y_mm, x_mm, rotation_deg = first.match.place_of(*middle)
    points = first.frame.to_frame(mesh.vertices)
    normals = np.asarray(mesh.vertex_normals)
    x, y, up = first.frame.axes
    away = np.hypot(points[:, 0] - x_mm, points[:, 1] - y_mm)
    is_near = (away < half) & (normals @ up > _SEEN)
    turn, normal = math.radians(rotation_deg), normals[is_near].mean(axis=0)
    along = math.cos(turn) * x + math.sin(turn) * y
    along -= along @ normal / (normal @ normal) * normal
    height = np.median(points[is_near, 2])
    centre = np.asarray(first.frame.origin) + x_mm * x + y_mm * y + height * up
    frame = Frame(centre, along, normal)
    along, up, _ = frame.axes
    frame = replace(frame, origin=centre - half * (along + up))
    view = view_of(mesh, frame, size_mm=2 * half)
    try:
        match, _ = match_together(view, scans, reading[np.newaxis])
    except ValueError:  # it sticks out of this view
        return first
    return OnStone(
        frame, match.among([first.match.next_best], len(scans)), first.reading
    )


def find_on_map(
    overview: xr.DataArray,
    scans: Mapping[str, xr.DataArray],
    readings: np.ndarray | None,
) -> dict[str, Match]:
    """Find scans on a larger map, each by itself; by the stage where heights do not find all.

    `readings` are as in `gst.check.matching.match_together`; None without a stage.
    """
    alone = {name: match_map(overview, scan) for name, scan in scans.items()}
    if readings is None or all(match.is_found for match in alone.values()):
        return alone
    together, number = match_together(overview, [*scans.values()], readings)
    if not together.is_found:
        return alone
    tied = together.each(readings[number])
    return {
        name: match if match.is_found else by_stage
        for (name, match), by_stage in zip(alone.items(), tied, strict=True)
    }
