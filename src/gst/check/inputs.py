"""Reads the files of a study before any work, with their contents and problems.

A study of hours must not fail at its last scan. After a fault in one file the others are still
checked, so all can be corrected at once.
"""

import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.amplitudes import UNIT_FACTOR, WRONG_UNIT, Amplitude, other_units
from gst.check.inspecting import scan_facts
from gst.config.contradictions import thinner_than_a_point
from gst.config.patches import COUNTERFACE, REPEAT, ScanFile, at_epoch
from gst.config.tables import columns_of
from gstlib.contact import check_grid
from gstlib.errors import (
    FaultError,
    GstError,
    InputError,
    accepting,
    concerning,
    unaccepted,
)
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan, unit_remedy
from gstlib.macroscale.active_tool import stated_tool
from gstlib.macroscale.face import grid_macroscale, thin_stone
from gstlib.preprocess.scans import check_unmeasured, cut_patch, mould_of
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import Frame, find_frame
from gstlib.surfaces.grid import MM_TO_UM, coarser, spacing_of

if TYPE_CHECKING:
    import trimesh

_log = logging.getLogger(__name__)

SAME_SCAN = "same_scan"  # the fault's name, as which a config accepts it
# Fewest points along a patch of a coarser scan.
_COARSE = 128
# If spacings of T0 and T1 differ by more than this share, the magnifications differ.
_SAME_SPACING = 1e-3
# Most groups of equal scans that a message lists.
_NAMED = 4
# Peak memory of the contact of the whole square, bytes per point (measured at 3012²).
_BYTES = 200


@dataclass(frozen=True)
class Inputs:
    """The contents of a study's files, and their faults."""

    # A row for each readable scan: ``patch, epoch, file``; ``points_x, points_y, spacing_x_um,
    # spacing_y_um``; ``unmeasured`` (share); ``Sq_um, tilt_x_mrad, tilt_y_mrad`` about and of the
    # least-squares plane; ``instrument, objective``; ``range_um``, of the heights as read.
    scans: pd.DataFrame
    stone: "trimesh.Trimesh | None"  # mm; None if it cannot be read
    # Where the square lies on it; None if there is no mesh, or if the config gives no frame.
    frame: Frame | None
    # The square and the face around it, from `gstlib.macroscale.face.grid_macroscale`; None if
    # they cannot be found.
    face: xr.Dataset | None
    # By patch and epoch, the patch as measured, with fewer points.
    coarse: dict[tuple[str, str], xr.DataArray]
    problems: list[GstError]  # everything that would stop the study


class _Piece(NamedTuple):
    """A scan of a patch, or the piece cut for it from a larger scan."""

    path: Path
    heights: xr.DataArray  # mm, with fewer points
    facts: dict[str, Any]  # its row of the table
    grid: tuple[tuple[int, ...], tuple[float, float]]  # (ny, nx), and (dy, dx) in mm
    content: tuple  # hash of its file's heights, and which piece of them it is
    amplitude: Amplitude


_Pieces = dict[tuple[str, str], _Piece]  # by patch and epoch


@dataclass(frozen=True)
class Asked:
    """Requirements of the config on the files."""

    mesh_unit: str  # as in `gstlib.io.meshes.read_mesh`
    face: Mapping  # the settings of `gstlib.macroscale.face.grid_macroscale`
    rounded: tuple  # as in `gstlib.conditions.rounded_form`
    scan_settings: Mapping  # the section ``scans`` of the config
    maximum_unmeasured: float  # largest share (0 to 1) of unmeasured points in a patch
    placed: bool  # the scans are laid on the mesh: both must then see the same stone
    reference: (
        bool  # the whole square is pressed at the scans' resolution, which takes memory
    )
    interlayer: Mapping | None  # the section ``interlayer`` of the config
    # As in `gstlib.macroscale.active_tool.ActiveTool.read`; None for one without a mesh.
    active_tool: Mapping | None
    accept: Sequence[str] = ()  # names of faults that do not stop the study


def check_inputs(
    mesh: str | Path | None, scans: Iterable[ScanFile], asked: Asked
) -> Inputs:
    """Read the mesh, unless it is None, and every scan of a study.

    Notes
    -----
    Oddities that may be right are logged as warnings.
    """
    stone, frame, face, problems = _read_stone(mesh, asked)
    heights = (
        square_of(face.height, asked.face["size_mm"]) if face is not None else None
    )
    pieces, unreadable = _read_scans(scans, asked, heights)
    at_t0 = {patch: piece for (patch, epoch), piece in pieces.items() if epoch == "T0"}
    rows = [piece.facts for piece in pieces.values()]
    problems += unreadable
    problems += [*_unlike_t0(pieces), *_same_scans(pieces)]
    if (counterface := pieces.get((COUNTERFACE, ""))) is not None:
        problems += _unlike_counterface(counterface, at_t0)
    if asked.reference:
        problems += _no_reference(at_t0, asked.face["size_mm"])
    if asked.interlayer is not None:
        spacings = [row[f"spacing_{axis}_um"] for row in rows for axis in "xy"]
        problems += thinner_than_a_point(asked.interlayer, max(spacings, default=0.0))
    edge_mm = heights.attrs["mesh_edge_mm"] if heights is not None else None
    for fault in other_units({name: at_t0[name].amplitude for name in at_t0}, edge_mm):
        if asked.placed:
            problems.append(fault)
        else:
            _log.warning("%s: %s. %s", fault.source, fault.problem, fault.remedy)
    return Inputs(
        pd.DataFrame(rows, columns=[*columns_of("inputs"), "range_um"]),
        stone,
        frame,
        face,
        {use: piece.heights for use, piece in pieces.items() if use[1]},
        unaccepted(problems, asked.accept),
    )


def _read_stone(
    mesh: str | Path | None, asked: Asked
) -> "tuple[trimesh.Trimesh | None, Frame | None, xr.Dataset | None, list[GstError]]":
    """The mesh, the frame of the square and the face, as far as they can be had."""
    stone = frame = face = None
    if mesh is None:
        return stone, frame, face, []
    try:
        stone = read_mesh(mesh, unit=asked.mesh_unit)
        points_mm, size_mm = asked.face["points_mm"], asked.face["size_mm"]
        frame = find_frame(points_mm, stone, size_mm=size_mm, source=str(mesh))
        # the fastest interpolation: to look at, and to hold scans against
        settings = {**asked.face, "interpolation": "linear", "source": str(mesh)}
        tool = stated_tool(asked.active_tool, asked.rounded)
        with accepting(asked.accept):
            face = grid_macroscale(stone, **settings, active_tool=tool)[0]
        return stone, frame, face, list(thin_stone(face.height, source=mesh))
    except GstError as error:
        return stone, frame, face, [error]


def _read_scans(
    scans: Iterable[ScanFile], asked: Asked, heights: xr.DataArray | None
) -> tuple[_Pieces, list[GstError]]:
    """The pieces of all scans, and the unusable files. Each file is read once."""
    by_file: dict[Path, list[ScanFile]] = {}
    for scan in scans:
        by_file.setdefault(scan.path, []).append(scan)
    unit, spacing_um = asked.scan_settings["unit"], asked.scan_settings["spacing_um"]
    pieces: _Pieces = {}
    problems: list[GstError] = []
    for path, uses in by_file.items():
        try:
            with accepting(asked.accept), concerning([use.patch for use in uses]):
                whole = read_scan(path, unit=unit, spacing_um=spacing_um)
        except GstError as error:
            problems.append(error)
            continue
        for use in uses:
            try:
                pieces[use.patch, use.epoch] = _cut(whole, use, asked, heights)
            except InputError as error:
                named = (
                    f"{path} ({at_epoch(use.patch, use.epoch)})" if use.epoch else path
                )
                problems.append(error.about(named, error.problem))
    return pieces, problems


def _cut(
    whole: xr.DataArray, use: ScanFile, asked: Asked, heights: xr.DataArray | None
) -> _Piece:
    """The piece of a scan that belongs to a patch."""
    settings, path = asked.scan_settings, use.path
    piece = cut_patch(
        whole,
        crop=use.crop,
        size_mm=settings["size_mm"],
        epoch=use.epoch or "T0",
        mould_flip=mould_of(settings["mould"], use.flip)["flip"],
    )
    check_unmeasured(piece, asked.maximum_unmeasured)
    facts = scan_facts(piece) | {
        "patch": use.patch,
        "epoch": use.epoch,
        "file": path.name,
    }
    facts["range_um"] = facts["highest_um"] - facts["lowest_um"]
    times = max(1, int(settings["size_mm"] / max(spacing_of(piece))) // _COARSE)
    return _Piece(
        path,
        coarser(piece, times),
        facts,
        (piece.shape, spacing_of(piece)),
        (hash(whole.values.tobytes()), use.crop),
        Amplitude.measured(
            path, piece, heights, use.place if use.epoch == "T0" else None
        ),
    )


def _unlike_t0(pieces: _Pieces) -> Iterator[GstError]:
    """Later scans that differ from T0 of their patch in spacing, or in the unit of heights."""
    for (patch, epoch), later in pieces.items():
        first = pieces.get((patch, "T0"))
        if epoch not in ("T1", REPEAT) or first is None:
            continue
        (_, spacing_0), (_, spacing_1) = first.grid, later.grid
        if not np.allclose(spacing_1, spacing_0, rtol=_SAME_SPACING, atol=0):
            yield InputError(
                later.path,
                f"its points are {_apart(spacing_1)} apart, those of {first.path} "
                f"{_apart(spacing_0)}",
                "Scan both epochs of a patch with the same objective, or resample one.",
            )
        before, after = first.amplitude.spread, later.amplitude.spread
        if before and after and not 1 / UNIT_FACTOR <= after / before <= UNIT_FACTOR:
            yield FaultError(
                WRONG_UNIT,
                later.path,
                f"its heights vary {after / before:.3g} times as much as in "
                f"{first.path}: one of the two is in another unit",
                "Export both epochs of a patch in one unit. "
                + unit_remedy(later.amplitude.states_unit),
                [patch],
            )


def _apart(spacing: tuple[float, float]) -> str:
    """How far apart points lie: along y and x, where these differ."""
    steps = dict.fromkeys(f"{step * MM_TO_UM:.5g}" for step in spacing)
    return " × ".join(steps) + " µm"


def _same_scans(pieces: _Pieces) -> Iterator[FaultError]:
    """Scans with equal heights. Noise is never the same twice, so one is a copy of another."""
    alike: dict[tuple, list[tuple[str, str]]] = {}
    for use, piece in pieces.items():
        if use[0] != COUNTERFACE:
            alike.setdefault(piece.content, []).append(use)
    copies = [uses for uses in alike.values() if len(uses) > 1]
    if copies:
        groups = [" and ".join(at_epoch(*use) for use in uses) for uses in copies]
        more = f"; and {len(groups) - _NAMED} more" * (len(groups) > _NAMED)
        yield FaultError(
            SAME_SCAN,
            ", ".join(str(pieces[use].path) for use in copies[0]),
            f"the heights are the same in {'; '.join(groups[:_NAMED])}{more}",
            "Give each scan its own file. Leave t1 or repeat empty in the patch table if there is "
            "no such scan.",
            [*dict.fromkeys(patch for uses in copies for patch, _ in uses)],
        )


def _unlike_counterface(face: _Piece, at_t0: Mapping[str, _Piece]) -> list[GstError]:
    """The first patch that the counterface does not fit, if any."""
    try:
        for piece in at_t0.values():
            check_grid(face.grid, piece.grid, source=face.path, patch_source=piece.path)
    except GstError as error:
        return [error]
    return []


def _no_reference(at_t0: Mapping[str, _Piece], square_mm: float) -> Iterator[GstError]:
    """Why the whole square cannot be pressed at the scans' resolution, if it cannot."""
    by_shape = {piece.grid[0]: (patch, piece) for patch, piece in at_t0.items()}
    grids = [*by_shape.values()]
    if not grids:
        return
    first = grids[0][1]
    count = round(square_mm / first.grid[1][1])
    needed = _BYTES * count**2
    if needed > (available := os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")):
        yield FaultError(
            "memory",
            "config, reference_realisations",
            f"the contact of the whole square at the scans' resolution has {count} × {count} "
            f"elements and needs {needed / 2**30:.1f} GiB of memory. This machine has "
            f"{available / 2**30:.1f} GiB",
            "Set reference_realisations to null, or run the study on a larger machine.",
        )
    for patch, other in grids[1:2]:
        (ny, nx), (other_ny, other_nx) = first.grid[0], other.grid[0]
        yield InputError(
            other.path,
            f"patch {patch} has {other_nx} × {other_ny} points, but {first.path} has {nx} × {ny}: "
            "the contact of the whole square needs scans of one grid",
            "Scan all patches alike, or set reference_realisations to null.",
        )
