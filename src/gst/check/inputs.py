"""Reads the files of a study before any work, with their contents and problems.

A study of hours must not fail at its last scan. After a fault in one file the others are still
checked, so all can be corrected at once.

Are all heights in one unit? A correlation ignores their scale; their amplitudes do not. The
amplitude of a scan is compared with the amplitudes of the other scans. In the waves that the mesh
resolves, it is also compared with the mesh. A patch that use has polished is smooth beside the
others, but as high as the mesh under it in those waves. On the files at hand, generated and
measured, neither ratio is further than a factor of two from the ratio of the other patches.
"""

import logging
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from skimage.transform import resize_local_mean

from gst.check.inspecting import scan_facts
from gst.check.sliding import sides_of
from gst.config.contradictions import thinner_than_a_point
from gst.config.patches import COUNTERFACE, REPEAT, ScanFile, at_epoch
from gst.config.tables import columns_of
from gstlib.contact import check_grid
from gstlib.coupling.comparison import WAVE_PER_EDGE
from gstlib.errors import (
    NOTE,
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
from gstlib.surfaces.footprints import PatchPosition, on_patch, spline_of, square_of
from gstlib.surfaces.frames import Frame, find_frame
from gstlib.surfaces.grid import MM_TO_UM, coarser, make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh

_log = logging.getLogger(__name__)

# Names of faults, as which a config accepts them.
SAME_SCAN, WRONG_UNIT = "same_scan", "units"
# Fewest points along a patch of a coarser scan.
_COARSE = 128
# If spacings of T0 and T1 differ by more than this share, the magnifications differ.
_SAME_SPACING = 1e-3
# Peak memory of the contact of the whole square, bytes per point (measured at 3012²).
_BYTES = 200
# ASSUME: Factor between units. Heights of one stone that differ by a factor of 10 are in different
# units. Two scans of a patch are compared, or scans and mesh in the waves that both resolve.
# Reason: Units differ by a factor of 10 or more. A smaller factor may be a calibration.
UNIT_FACTOR = 10.0
# Where the mesh sees no waves of a patch, polish could be mistaken for a unit: only this is none.
_FACTOR_UNSEEN = 100.0
# This factor may be a calibration.
_ODD_FACTOR = 4.0
# Fewest blocks along a patch's side: 2 × 2 blocks leave one degree of freedom after levelling.
_FEWEST_BLOCKS = 2


@dataclass
class Inputs:
    """The contents of a study's files, and their faults."""

    # A row for each readable scan: ``patch, epoch, file``; ``points_x, points_y, spacing_x_um,
    # spacing_y_um``; ``unmeasured`` (share); ``Sq_um, tilt_x_mrad, tilt_y_mrad`` about and of the
    # least-squares plane; ``instrument, objective``; ``range_um``, of the heights as read.
    scans: pd.DataFrame = field(default_factory=pd.DataFrame)
    stone: "trimesh.Trimesh | None" = None  # mm; None if it cannot be read
    # Where the square lies on it; None if there is no mesh, or if the config gives no frame.
    frame: Frame | None = None
    # The square and the face around it, from `gstlib.macroscale.face.grid_macroscale`; None if
    # they cannot be found.
    face: xr.Dataset | None = None
    # By patch and epoch, the patch as measured, with fewer points.
    coarse: dict[tuple[str, str], xr.DataArray] = field(default_factory=dict)
    # Everything that would stop the study.
    problems: list[GstError] = field(default_factory=list)


class _Piece(NamedTuple):
    """A scan of a patch, or the piece cut for it from a larger scan."""

    path: Path
    heights: xr.DataArray  # mm, with fewer points
    facts: dict[str, Any]  # its row of the table
    grid: tuple[tuple[int, ...], tuple[float, float]]  # (ny, nx), and (dy, dx) in mm
    content: tuple  # hash of its file's heights, and which piece of them it is
    # How much heights vary over an eighth of the scan (mm), regardless of tilt and spikes.
    spread: float
    # R.m.s. heights (mm) of the scan and of the mesh under it, in waves that the mesh's edges
    # resolve; None if these are longer than the scan.
    waves: tuple[float, float] | None
    states_unit: bool  # the file, so that the config has no effect on it


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
    # the whole square is pressed at the scans' resolution, which takes memory
    reference: bool
    interlayer: Mapping | None  # the section ``interlayer`` of the config
    # As in `gstlib.macroscale.active_tool.ActiveTool.read`; None for one without a mesh.
    active_tool: Mapping | None
    accept: Sequence[str] = ()  # names of faults that do not stop the study


@contextmanager
def noting(problems: list[GstError]) -> Iterator[None]:
    """Note the error of a step, so that all can be corrected at once."""
    try:
        yield
    except GstError as error:
        problems.append(error)


def check_inputs(
    mesh: str | Path | None, scans: Iterable[ScanFile], asked: Asked
) -> Inputs:
    """Read the mesh, unless it is None, and every scan of a study.

    Notes
    -----
    Oddities that may be right are logged as warnings.
    """
    inputs = Inputs()
    if mesh is not None:
        with noting(inputs.problems):
            _read_stone(inputs, mesh, asked)
    size_mm, square = asked.face["size_mm"], None
    if inputs.face is not None:
        square = square_of(inputs.face.height, size_mm)
    pieces = _read_scans(scans, asked, square, inputs.problems)
    rows = [piece.facts for piece in pieces.values()]
    at_t0 = {patch: piece for (patch, epoch), piece in pieces.items() if epoch == "T0"}
    inputs.problems += [*_unlike_t0(pieces), *_same_scans(pieces)]
    if (face := pieces.get((COUNTERFACE, ""))) is not None:
        with noting(inputs.problems):
            for piece in at_t0.values():
                check_grid(
                    face.grid, piece.grid, source=face.path, patch_source=piece.path
                )
    if asked.reference:
        inputs.problems += _no_reference(at_t0, size_mm)
    spacings = [row[f"spacing_{axis}_um"] for row in rows for axis in "xy"]
    inputs.problems += thinner_than_a_point(
        asked.interlayer, max(spacings, default=0.0)
    )
    for fault in _other_units(at_t0, square):
        if asked.placed:
            inputs.problems.append(fault)
        else:
            _warn_of(fault)
    inputs.scans = pd.DataFrame(rows, columns=[*columns_of("inputs"), "range_um"])
    inputs.coarse = {use: piece.heights for use, piece in pieces.items() if use[1]}
    inputs.problems = unaccepted(inputs.problems, asked.accept)
    return inputs


def _warn_of(fault: FaultError) -> None:
    _log.warning("%s: %s. %s", fault.source, fault.problem, fault.remedy)


def _read_stone(inputs: Inputs, mesh: str | Path, asked: Asked) -> None:
    """Read the mesh, the frame of the square and the face, as far as they can be had."""
    inputs.stone = stone = read_mesh(mesh, unit=asked.mesh_unit)
    points_mm, size_mm = asked.face["points_mm"], asked.face["size_mm"]
    inputs.frame = find_frame(points_mm, stone, size_mm=size_mm, source=str(mesh))
    # the fastest interpolation: to look at, and to hold scans against
    settings = {**asked.face, "interpolation": "linear", "source": str(mesh)}
    tool = stated_tool(asked.active_tool, asked.rounded)
    with accepting(asked.accept):
        inputs.face = grid_macroscale(stone, **settings, active_tool=tool)[0]
    inputs.problems += thin_stone(inputs.face.height, source=mesh)


def _read_scans(
    scans: Iterable[ScanFile],
    asked: Asked,
    square: xr.DataArray | None,
    problems: list[GstError],
) -> _Pieces:
    """The pieces of all scans; unusable files are `problems`. Each file is read once."""
    by_file: dict[Path, list[ScanFile]] = {}
    for scan in scans:
        by_file.setdefault(scan.path, []).append(scan)
    unit, spacing_um = asked.scan_settings["unit"], asked.scan_settings["spacing_um"]
    pieces: _Pieces = {}
    for path, uses in by_file.items():
        with noting(problems):
            with accepting(asked.accept), concerning([use.patch for use in uses]):
                whole = read_scan(path, unit=unit, spacing_um=spacing_um)
            for use in uses:
                with noting(problems):
                    pieces[use.patch, use.epoch] = _cut(whole, use, asked, square)
    return pieces


def _cut(
    whole: xr.DataArray, use: ScanFile, asked: Asked, square: xr.DataArray | None
) -> _Piece:
    """The piece of a scan that belongs to a patch."""
    settings, path = asked.scan_settings, use.path
    try:
        piece = cut_patch(
            whole,
            crop=use.crop,
            size_mm=settings["size_mm"],
            epoch=use.epoch or "T0",
            mould_flip=mould_of(settings["mould"], use.flip)["flip"],
        )
        check_unmeasured(piece, asked.maximum_unmeasured)
    except InputError as error:
        where = f" ({at_epoch(use.patch, use.epoch)})" * bool(use.epoch)
        raise error.about(f"{path}{where}", error.problem) from None
    facts = scan_facts(piece)
    facts |= {"patch": use.patch, "epoch": use.epoch, "file": path.name}
    facts["range_um"] = facts["highest_um"] - facts["lowest_um"]
    times = max(1, int(settings["size_mm"] / max(spacing_of(piece))) // _COARSE)
    apart = max(1, piece.shape[1] // 8)
    steps = piece.values[:, apart:] - piece.values[:, :-apart]
    waves = None
    if square is not None and use.place is not None and use.epoch == "T0":
        waves = _common_waves(piece, square, use.place)
    return _Piece(
        path,
        coarser(piece, times),
        facts,
        grid=(piece.shape, spacing_of(piece)),
        content=(hash(whole.values.tobytes()), use.crop),
        spread=float(np.subtract(*np.nanpercentile(steps, [75, 25]))),
        waves=waves,
        states_unit=piece.attrs.get("unit_stated") == "yes",
    )


def _common_waves(
    scan: xr.DataArray, square: xr.DataArray, place: PatchPosition
) -> tuple[float, float] | None:
    side = min(sides_of(scan))
    blocks = int(2 * side / (WAVE_PER_EDGE * square.attrs["mesh_edge_mm"]))
    if blocks < _FEWEST_BLOCKS:
        return None
    level = remove_plane(scan)[0].fillna(0.0).values
    under = on_patch(spline_of(square), place, scan.shape, side)

    def height(values: np.ndarray) -> float:
        means = resize_local_mean(values, (blocks, blocks))
        return float(remove_plane(make_surface(means, side / blocks))[0].std())

    return height(level), height(under)


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
        before, after = first.spread, later.spread
        if before and after and not 1 / UNIT_FACTOR <= after / before <= UNIT_FACTOR:
            yield FaultError(
                WRONG_UNIT,
                later.path,
                f"its heights vary {after / before:.3g} times as much as in "
                f"{first.path}: one of the two is in another unit",
                "Export both epochs of a patch in one unit. "
                + unit_remedy(later.states_unit),
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
        groups = (" and ".join(at_epoch(*use) for use in uses) for uses in copies)
        yield FaultError(
            SAME_SCAN,
            ", ".join(str(pieces[use].path) for use in copies[0]),
            f"the heights are the same in {'; '.join(groups)}",
            "Give each scan its own file. Leave t1 or repeat empty in the patch table if there is "
            "no such scan.",
            [*dict.fromkeys(patch for uses in copies for patch, _ in uses)],
        )


def _no_reference(at_t0: Mapping[str, _Piece], square_mm: float) -> Iterator[GstError]:
    """Why the whole square cannot be pressed at the scans' resolution, if it cannot."""
    if not at_t0:
        return
    first = next(iter(at_t0.values()))
    (ny, nx), (_, dx) = first.grid
    count = round(square_mm / dx)
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
    for patch, other in at_t0.items():
        other_ny, other_nx = other.grid[0]
        if (other_ny, other_nx) != (ny, nx):
            yield InputError(
                other.path,
                f"patch {patch} has {other_nx} × {other_ny} points, but {first.path} has "
                f"{nx} × {ny}: the contact of the whole square needs scans of one grid",
                "Scan all patches alike, or set reference_realisations to null.",
            )
            return


def _other_units(
    at_t0: Mapping[str, _Piece], square: xr.DataArray | None
) -> Iterator[FaultError]:
    """Scans with heights in another unit than the other scans, or all than the mesh.

    A lesser difference is logged as a warning, a mesh whose edges are too long to tell as a note.
    """
    alone = [fault for patch in at_t0 for fault in _unlike_others(patch, at_t0)]
    yield from alone
    waves = [piece.waves for piece in at_t0.values() if piece.waves]
    remedy = unit_remedy(all(piece.states_unit for piece in at_t0.values()))
    if at_t0 and square is not None and not waves:
        # Bounds alone do not suffice, because polish could be mistaken for a unit.
        _log.log(
            NOTE,
            "scans: the unit of all heights could not be checked, because a mesh with edges of "
            "%.3g mm does not show waves of a patch. Compare their range with the range on the "
            "instrument. If it differs: %s",
            square.attrs["mesh_edge_mm"],
            remedy,
        )
    if alone or not waves:
        return
    scan, mesh = np.sqrt(np.square(waves).mean(axis=0))
    if max(scan, mesh) > UNIT_FACTOR * min(scan, mesh):
        yield FaultError(
            WRONG_UNIT,
            "scans",
            f"in the waves that scans and mesh both resolve, the scans are {scan * MM_TO_UM:.3g} "
            f"µm high (r.m.s.) and the mesh under them {mesh * MM_TO_UM:.3g} µm",
            f"{remedy} Check inputs.mesh_unit, too. If both units are right, the mesh does not "
            "show how the patches lie: set coupling to paper.",
        )


def _unlike_others(patch: str, at_t0: Mapping[str, _Piece]) -> Iterator[FaultError]:
    """The fault of one patch, if its heights are of another order than those of all others."""
    own = at_t0[patch]
    # of two, each is compared with the other; of more, the median is not moved by one
    spreads = [
        other.spread for name, other in at_t0.items() if name != patch or len(at_t0) > 2
    ]
    if not own.spread or not spreads or not (usual := float(np.median(spreads))):
        return
    factor, (scan, mesh) = own.spread / usual, own.waves or (0.0, 0.0)
    off, unit = abs(math.log(factor)), math.log(_FACTOR_UNSEEN)
    if scan and mesh:
        same_way = math.log(scan / mesh) * math.copysign(1.0, math.log(factor))
        off, unit = min(off, same_way), math.log(UNIT_FACTOR)
    fault = FaultError(
        WRONG_UNIT,
        own.path,
        f"its heights (patch {patch}) vary {factor:.3g} times as much as on the other "
        "patches" + (", and do not fit the mesh under it" if scan and mesh else ""),
        f"Export all scans in one unit and with one calibration. {unit_remedy(own.states_unit)}",
        [patch],
    )
    if off > unit:
        yield fault
    elif off > math.log(_ODD_FACTOR):
        _warn_of(fault)
