"""Positions of scans on a stone without clicking, from an overview map or from the stage.

The overview is found on the mesh and the scans on the overview, by their heights; without one, the
stage ties the scans together, and they are found on the mesh as one map.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import xarray as xr

from gst.check.matching import Match
from gst.check.nearby import match_near
from gst.check.sliding import sides_of, wrapped
from gst.setup.finding import find_on_map, find_on_stone, view_of
from gstlib.coupling.comparison import shows_waves
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh


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
        return Matches(None, None, {})
    if lying is None or not lying.match.is_found:
        return Matches(None, lying and lying.match, {})
    if overview is None:
        assert readings is not None
        tied = lying.match.each(readings[lying.reading])
        return Matches(lying.frame, lying.match, dict(zip(scans, tied, strict=True)))
    middle = [float(overview[axis].mean()) for axis in ("y", "x")]
    try:
        inner = find_on_map(overview, scans, readings)
    except ValueError:  # its points are too far apart for them
        inner = {}
    each = {name: lying.match.carrying(match, middle) for name, match in inner.items()}
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
) -> tuple[Frame, float]:
    """A square around the scans that are found: its frame and its side.

    Its side is `least_mm`, or more if the scans, with a side of `side_mm`, need it.
    """
    assert matches.frame is not None
    centres = np.array([match.place[:2] for match in matches.placed.values()])
    span = float(np.ptp(centres, axis=0).max()) + math.sqrt(2) * side_mm
    size_mm = max(least_mm, math.ceil(2 * span) / 2)  # in halves of a millimetre
    middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
    corner = middle - size_mm / 2
    return replace(matches.frame, origin=_on_stone(matches.frame, *corner)), size_mm


def _on_stone(frame: Frame, y_mm: float, x_mm: float) -> np.ndarray:
    """A point of a frame's plane in the coordinates of the mesh."""
    x_axis, y_axis, _ = frame.axes
    point: np.ndarray = np.asarray(frame.origin) + x_mm * x_axis + y_mm * y_axis
    return point


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
    names = [name for name in scans if name in places]
    matches = match_near(
        view, [scans[name] for name in names], [places[name] for name in names]
    )
    return dict(zip(names, matches, strict=True))


def seen_in(frame: Frame, matches: Matches) -> dict[str, PatchPosition]:
    """Positions of the scans that are found, on a square."""
    assert matches.frame is not None
    along = frame.axes[:2] @ matches.frame.axes[0]
    turn = math.degrees(math.atan2(along[1], along[0]))
    places = {}
    for name, match in matches.placed.items():
        y, x, own = match.place
        ((u, v, _),) = frame.to_frame(_on_stone(matches.frame, y, x)[np.newaxis])
        places[name] = PatchPosition(float(v), float(u), wrapped(own + turn))
    return places


def corners_of(frame: Frame, size_mm: float) -> list[list[float]]:
    """The reference corner of a square and the ends of its x and y, for the config."""
    ends = (0, 0), (0, size_mm), (size_mm, 0)
    return [np.round(_on_stone(frame, *end), 4).tolist() for end in ends]


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
