"""Search of scans on the mesh of a stone: with an overview map, by the stage, or near a start.

The overview is found on the mesh and the scans on the overview, by their heights; without one, the
stage ties the scans together, and they are found on the mesh as one map. The stone is viewed from
two opposite sides, as it rests when it is put down; then, if nothing is found, from the other four.
Each match is refined on shorter elements, with the mesh as seen straight from above.
"""

import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
import xarray as xr

from gst.check.matching import Match, match_map, match_near, match_together
from gst.check.sliding import sides_of, wrapped
from gstlib.coupling.comparison import shows_waves
from gstlib.preprocess.interpolation import interpolate
from gstlib.surfaces.footprints import PatchPosition
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
# The stage's zero is anywhere, and files do not contain the direction of its axes.
_DIRECTIONS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
# How far around a square (mm) the mesh is looked at for scans that may stick out of it.
_AROUND = 1.5


class Matches(NamedTuple):
    """Scans that were matched, found or not."""

    frame: Frame | None  # in which places are; None if nothing was found on the stone
    # Of the overview, or of all scans together; None if they cannot be matched.
    on_stone: Match | None
    scans: dict[
        str, Match
    ]  # those that are not found have a place that is not to be used

    @property
    def placed(self) -> dict[str, Match]:
        """The scans that are found."""
        return {name: match for name, match in self.scans.items() if match.is_found}


def _stage_readings(stages: Sequence[tuple[float, float]]) -> np.ndarray:
    """Offsets (k, n, 2) along y and x of scans from their middle, as the stage may mean them."""
    offsets = np.asarray(stages)[:, ::-1]
    return np.array([(offsets - offsets.mean(axis=0)) * signs for signs in _DIRECTIONS])


def located(
    mesh: "trimesh.Trimesh",
    scans: Mapping[str, xr.DataArray],
    *,
    overview: xr.DataArray | None,
    stages: Sequence[tuple[float, float]] | None,
) -> Matches:
    """Find scans (y, x) on a stone (mm), with an overview or with places (x, y) from the stage."""
    readings = None if stages is None else _stage_readings(stages)
    if overview is not None:
        lying = find_on_stone(mesh, [overview], np.zeros((1, 1, 2)))
    elif readings is not None:
        lying = find_on_stone(mesh, [*scans.values()], readings)
    else:
        lying = None
    if lying is None or not lying.match.is_found:
        return Matches(None, lying and lying.match, {})
    if overview is None:
        assert readings is not None
        tied = lying.match.each(readings[lying.reading])
        return Matches(lying.frame, lying.match, dict(zip(scans, tied, strict=True)))
    each = {}
    with contextlib.suppress(ValueError):  # its points are too far apart for the scans
        each = find_on_map(overview, scans, readings)
    middle = [float(overview[axis].mean()) for axis in ("y", "x")]
    each = {name: lying.match.carrying(match, middle) for name, match in each.items()}
    return Matches(lying.frame, lying.match, _laid_alike(each))


def _laid_alike(matches: dict[str, Match]) -> dict[str, Match]:
    """Scans that are mirrored or inverted otherwise than most cannot be right."""
    laid = {name: (each.mirrored, each.inverted) for name, each in matches.items()}
    right = [laid[name] for name, each in matches.items() if each.is_found]
    usual = max(right, key=right.count, default=None)
    return {
        name: replace(each, is_found=each.is_found and laid[name] == usual)
        for name, each in matches.items()
    }


def square_around(
    matches: Matches, *, side_mm: float, least_mm: float
) -> tuple[list[list[float]], float]:
    """A square around the scans that are found: its three points for the config, and its side.

    Its side is `least_mm`, or more if the scans, with a side of `side_mm`, need it.
    """
    assert matches.frame is not None
    centres = np.array([match.place[:2] for match in matches.placed.values()])
    span = float(np.ptp(centres, axis=0).max()) + math.sqrt(2) * side_mm
    size_mm = max(least_mm, math.ceil(2 * span) / 2)  # in halves of a millimetre
    y, x = (centres.min(axis=0) + centres.max(axis=0) - size_mm) / 2
    corners = (y, x), (y, x + size_mm), (y + size_mm, x)
    points = [_on_stone(matches.frame, *corner) for corner in corners]
    return np.round(points, 4).tolist(), size_mm


def _on_stone(frame: Frame, y_mm: float, x_mm: float) -> np.ndarray:
    """A point of a frame's plane in the coordinates of the mesh."""
    return np.asarray(frame.origin) + np.array([x_mm, y_mm]) @ frame.axes[:2]


def snapped(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    size_mm: float,
    scans: Mapping[str, xr.DataArray],
    places: Mapping[str, PatchPosition],
) -> dict[str, Match]:
    """Positions of scans that are within 0.75 mm of their places on a square of a stone.

    Raises a `ValueError` if the mesh is too coarse.
    """
    view = view_of(mesh, frame, size_mm=size_mm, around_mm=_AROUND)
    side = min(min(sides_of(scan)) for scan in scans.values())
    if not shows_waves(view, side):
        edge = view.attrs["mesh_edge_mm"]
        raise ValueError(
            f"edges of {edge:.2g} mm show no waves in scans of {side:.2g} mm"
        )
    on_view = {
        name: places[name]
        for name in scans
        if name in places
        and all(-_AROUND <= mm <= size_mm + _AROUND for mm in places[name][:2])
    }
    if not on_view:
        return {}
    near = [scans[name] for name in on_view]
    matches = match_near(view, near, [*on_view.values()])
    return dict(zip(on_view, matches, strict=True))


def seen_in(frame: Frame, matches: Matches) -> dict[str, PatchPosition]:
    """Positions of the scans that are found, on a square."""
    assert matches.frame is not None
    along = frame.axes[:2] @ matches.frame.axes[0]
    turn = math.degrees(math.atan2(along[1], along[0]))
    places = {}
    for name, match in matches.placed.items():
        y, x, own = match.place
        u, v, _ = frame.to_frame(_on_stone(matches.frame, y, x))
        places[name] = PatchPosition(float(v), float(u), wrapped(own + turn))
    return places


def described(match: Match) -> str:
    """How well a scan fits where it was found, or that it is not certain, or fits nowhere."""
    fit = f"r {match.correlation:.2f}, lead {match.lead:.2f} over the next best"
    if match.is_found:
        return f"{fit}, ± {max(1, round(1e3 * match.error_mm))} µm"
    if match.is_uncertain:
        error = f"± {math.ceil(1e3 * match.error_mm)} µm"
        others = "; ".join(
            f"x {at.x_mm:.2f}, y {at.y_mm:.2f} mm" for at in match.alternatives
        )
        more = f", and as well at {others}" * bool(others)
        at = f"x {match.place.x_mm:.2f}, y {match.place.y_mm:.2f} mm"
        return f"not certain (fits at {at}, {error}{more}); add an overview map"
    return f"not found ({fit})"


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
    middle = points.mean(axis=0)
    axes = np.linalg.eigh(np.cov(points, rowvar=False))[1].T  # the thinnest first
    for n in range(3):
        pair = []
        for normal in (axes[n], -axes[n]):
            frame = Frame(middle, axes[(n + 1) % 3], normal)
            seen = frame.to_frame(points)[:, :2]
            x, y = seen.min(axis=0)
            frame = replace(frame, origin=_on_stone(frame, y, x))
            pair.append((frame, float(np.ptp(seen, axis=0).max())))
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
    gap = _GAP * edge
    is_near = ((points > -gap) & (points < size_mm + gap))[:, :2].all(axis=1)
    cloud = points[is_seen & is_near]
    along = axis_coordinates(max(2, round(size_mm / step)), step)
    heights = np.full(2 * along.shape, np.nan)
    if len(cloud) > 3:
        # straight lines between vertices would cut the shortest waves that the mesh has
        heights = interpolate("clough-tocher", cloud, along, edge)
        places = np.stack(np.meshgrid(along, along), axis=-1)
        tree = scipy.spatial.KDTree(cloud[:, :2])
        away, _ = tree.query(places, distance_upper_bound=gap)
        heights[np.isinf(away)] = np.nan
    view = make_surface(heights, step, mesh_edge_mm=edge)
    view = view.assign_coords(y=view.y - around_mm, x=view.x - around_mm)
    is_stone = np.isfinite(heights)
    if not is_stone.any():
        return view
    rows, columns = (np.flatnonzero(is_stone.any(axis=axis)) for axis in (1, 0))
    return view[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _from_above(
    mesh: "trimesh.Trimesh",
    first: OnStone,
    scans: Sequence[xr.DataArray],
    readings: np.ndarray,
) -> OnStone:
    """The same scans on the mesh as it looks from straight above where they were found."""
    reading = readings[first.reading]
    low, high = reading.min(axis=0), reading.max(axis=0)
    diagonal = max(np.hypot(*sides_of(scan)) for scan in scans)
    half = (high - low).max() / 2 + diagonal / 2 + _MARGIN
    y_mm, x_mm, rotation_deg = first.match.place_of(*(low + high) / 2)
    points = first.frame.to_frame(mesh.vertices)
    normals = np.asarray(mesh.vertex_normals)
    x, y, up = first.frame.axes
    away = np.hypot(points[:, 0] - x_mm, points[:, 1] - y_mm)
    is_near = (away < half) & (normals @ up > _SEEN)
    turn, normal = math.radians(rotation_deg), normals[is_near].mean(axis=0)
    along = math.cos(turn) * x + math.sin(turn) * y
    along -= along @ normal / (normal @ normal) * normal
    height = np.median(points[is_near, 2])
    centre = _on_stone(first.frame, y_mm, x_mm) + height * up
    frame = Frame(centre, along, normal)
    frame = replace(frame, origin=_on_stone(frame, -half, -half))
    view = view_of(mesh, frame, size_mm=2 * half)
    try:
        match, _ = match_together(view, scans, reading[np.newaxis])
    except ValueError:  # it sticks out of this view
        return first
    match = match.among([first.match.next_best], len(scans))
    return first._replace(frame=frame, match=match)


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
