"""Positions of the scans on the square for `gst new`: from the mesh, the stage, or missing."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gst.config.reading import complete
from gst.config.todo import TODO, is_to_do
from gst.setup.place_matching import Matches, corners_of, described, located, on_square
from gst.setup.scan_folder import Scan
from gstlib.surfaces.footprints import PatchPosition

if TYPE_CHECKING:
    import trimesh

__all__ = ["DOUBT", "OK", "SAME_SIZE", "TO_DO", "Line", "Where", "default_square_mm"]
__all__ += ["where_scanned"]

OK, DOUBT, TO_DO = "ok", "look", "to do"
# Sides of a patch that differ by less are equal: as `gstlib.io.scans.cut_scan` has it.
SAME_SIZE = 0.01
# ASSUME: Least distance of scan positions. Scans of different patches share at most half of their
# side. Reason: If stage coordinates are closer, they were not recorded, or the stone was moved
# between the scans.
_LEAST_APART = 0.5


class Line(NamedTuple):
    """A line of the listing."""

    topic: str
    text: str
    state: str = ""


class Where(NamedTuple):
    """Positions of scans on the square, by patch, and the values for the config."""

    places: dict[str, PatchPosition]
    values: dict[str, Any]
    lines: list[Line]


def where_scanned(
    mesh: "trimesh.Trimesh | None",
    first: Mapping[str, Scan | None],
    overviews: Sequence[Scan],
    invert: bool | str,
    size_mm: float | str,
) -> Where:
    """Positions of scans: on the mesh, or at least their distances, or none.

    The mesh is none if its unit is not known; `first` has the scan of each patch before use.
    """
    scans = {patch: scan for patch, scan in first.items() if scan is not None}
    stages, doubt = _stages([*first.values()], size_mm)
    overviews = [scan for scan in overviews if not is_to_do(scan.unit)]
    if isinstance(size_mm, str) or not scans:
        mesh = None
    if overviews and mesh is None:
        doubt = (
            f"on {overviews[0].name}, once the units and the side of a patch are known (gst place: "
            "Find the exact positions)"
        )
        return Where({}, {}, [Line("Where", doubt, TO_DO)])
    if mesh is not None and (overviews or stages is not None):
        overview = max(overviews, key=lambda scan: min(scan.size_mm), default=None)
        matches = located(
            mesh,
            {patch: scan.coarse for patch, scan in scans.items()},
            overview=None if overview is None else overview.coarse,
            stages=stages,
        )
        by = "the stage's distances" if overview is None else overview.name
        if matches.placed:
            return _by_heights(matches, invert, float(size_mm), by)
        fit = (
            described(matches.on_stone)
            if matches.on_stone
            else "too small for the mesh"
        )
        none = ", and no scan was found on it" * bool(matches.frame)
        doubt = f"{by}, on the mesh: {fit}{none}" + f"; {doubt}" * bool(doubt)
    if stages is None:
        text = f"{doubt}: please enter x_mm and y_mm"
        return Where({}, {}, [Line("Where", text, TO_DO)])
    return _by_stage([*scans], stages, float(size_mm), is_mould=invert is True)


def default_square_mm() -> float:
    side: float = complete({})["square"]["size_mm"]
    return side


def _by_heights(matches: Matches, invert: bool | str, size_mm: float, by: str) -> Where:
    """The square around the scans that were found, their orientation, and its certainty."""
    frame, square_mm, places = on_square(
        matches, side_mm=size_mm, least_mm=default_square_mm()
    )
    first = next(iter(matches.placed.values()))
    inverted = first.inverted
    values = {
        "square.size_mm": square_mm,
        "square.points_mm": corners_of(frame, square_mm),
        "scans.mould.invert": inverted,
        "scans.mould.flip": "x" if first.mirrored else None,
        "uncertainty.placement_um": math.ceil(matches.error_um),
    }
    assert matches.on_stone is not None
    lines = [Line("Where", f"{by}, on the mesh: {described(matches.on_stone)}", OK)]
    for patch, match in matches.scans.items():
        lines.append(
            Line("", f"{patch}: {described(match)}", OK if match.is_found else TO_DO)
        )
    laid = "mirrored" * first.mirrored, "inverted, as moulds" * inverted
    how = " and ".join(filter(None, laid)) or "as it was scanned"
    lines.append(Line("", f"the scanned surface fits the mesh {how}", OK))
    if not is_to_do(invert) and invert != inverted:
        values["scans.mould.invert"] = f"{TODO} {str(inverted).lower()}"
        text = (
            "their change with use indicates the other sign of heights: which is right?"
        )
        lines.append(Line("", text, TO_DO))
    return Where(places, values, lines)


def _stages(
    scans: Sequence[Scan | None], size_mm: float | str
) -> tuple[list[tuple[float, float]] | None, str]:
    """The stage's places (x, y), mm; or why they cannot be used."""
    there = [scan for scan in scans if scan is not None]
    stages = [scan.stage_mm for scan in there if scan.stage_mm is not None]
    if not stages or isinstance(size_mm, str):
        return None, "no stage coordinates in the files, and no overview map"
    if len(stages) < len(scans):
        return None, "stage coordinates are not in all files"
    apart = [np.abs(np.subtract(*two)).max() for two in combinations(stages, 2)]
    if min(apart, default=size_mm) < _LEAST_APART * size_mm:
        return None, "stage coordinates are the same for different places"
    sizes = np.array([scan.size_mm for scan in there])
    if (np.ptp(sizes, axis=0) > SAME_SIZE * sizes.min()).any():
        return (
            None,
            "stage coordinates are of maps of different sizes, corners or centres",
        )
    return stages, ""


def _by_stage(
    patches: Sequence[str],
    stages: Sequence[tuple[float, float]],
    size_mm: float,
    *,
    is_mould: bool,
) -> Where:
    """Distances of patches, in the middle of a square that is still to be laid."""
    at = np.asarray(stages) * (
        (-1, 1) if is_mould else (1, 1)
    )  # a mould is seen from behind
    middle = (at.min(axis=0) + at.max(axis=0)) / 2
    span = float(np.ptp(at, axis=0).max()) + size_mm
    square_mm = max(
        default_square_mm(), math.ceil(2 * span) / 2
    )  # in halves of a millimetre
    places = {}
    for patch, place in zip(patches, at, strict=True):
        x, y = np.round(place - middle + square_mm / 2, 4).tolist()
        places[patch] = PatchPosition(y, x)
    mirrored = ", mirrored in x as moulds are" * is_mould
    text = f"by the stage, over {span:.3g} mm{mirrored}; no file contains the direction of its axes"
    return Where(places, {"square.size_mm": square_mm}, [Line("Where", text, DOUBT)])
