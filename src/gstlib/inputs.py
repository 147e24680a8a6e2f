"""Every file of a study read once, quickly, before any work: what it holds, and all that is wrong.

A study of hours must not end at its last scan. What is found wrong with one file does not keep the
others from being looked at, so that all can be put right at once.
"""

import hashlib
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.counterface import check_grid
from gstlib.errors import GstError, InputError, InputsError
from gstlib.inspection import held_height, mesh_facts, scan_facts
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import check_size, cut_scan, read_scan, read_settings
from gstlib.preprocess.filling import check_unmeasured
from gstlib.preprocess.frame import find_frame
from gstlib.preprocess.gridding import grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import spacing_of

__all__ = ["Inputs", "ScanFile", "check_inputs"]

_log = logging.getLogger(__name__)

_FACTS = (
    "points_x", "points_y", "spacing_x_um", "spacing_y_um", "unmeasured", "Sq_um", "tilt_x_mrad",
    "tilt_y_mrad", "instrument", "objective",
)  # fmt: skip
# Spacings of T0 and T1 that differ by more than this share are of two magnifications.
_SAME_SPACING = 1e-3


@dataclass(frozen=True)
class ScanFile:
    """A scan that the study uses: which file, for what, and the piece to cut from it.

    Attributes
    ----------
    path : Path
    patch : str
        Patch, or "counterface".
    epoch : str
        T0, T1, or empty.
    crop : (x, y) or None
        Centre (mm) of the piece, from the scan's centre; None for the whole scan.
    """

    path: Path
    patch: str
    epoch: str
    crop: tuple[float, float] | None = None


@dataclass(frozen=True)
class Inputs:
    """What was found.

    Attributes
    ----------
    scans : pandas.DataFrame
        A row for each readable scan: ``patch, epoch, file`` and the facts of `scan_facts`.
    ranges_um : tuple of float
        From the lowest to the highest point of each of these scans, µm.
    mesh : dict or None
        The facts of `mesh_facts`; None if the mesh cannot be read.
    square : (ny, nx) xarray.DataArray or None
        Heights of the analysed square (mm), its plane removed; None if it cannot be had.
    problems : tuple of GstError
        Everything that would stop the study.
    """

    scans: pd.DataFrame
    ranges_um: tuple[float, ...]
    mesh: dict | None
    square: xr.DataArray | None
    problems: tuple[GstError, ...]

    def raise_problems(self) -> None:
        """Raise `InputsError` if there are any."""
        if self.problems:
            raise InputsError(self.problems)


@dataclass(frozen=True)
class _Piece:
    """What is remembered of a piece of a scan, to hold it against the others."""

    path: Path
    shape: tuple[int, int]
    spacing: tuple[float, float]  # dy, dx, mm
    content: bytes  # a hash of its heights

    @classmethod
    def of(cls, piece: xr.DataArray, path: Path) -> "_Piece":
        content = hashlib.blake2b(np.ascontiguousarray(piece.values)).digest()
        return cls(path, piece.shape, spacing_of(piece), content)


def check_inputs(
    mesh: str | Path | None,
    scans: Iterable[ScanFile],
    *,
    mesh_unit: str,
    square: Mapping,
    macroscale: Mapping,
    scan_settings: Mapping,
    maximum_unmeasured: float,
) -> Inputs:
    """Read the mesh and every scan of a study.

    Parameters
    ----------
    mesh, mesh_unit
        As in `read_mesh`; a mesh of None is not looked at.
    scans : iterable of ScanFile
    square, macroscale, scan_settings : mapping
        The sections ``square``, ``macroscale`` and ``scans`` of the config.
    maximum_unmeasured : float
        Largest share (0 to 1) of unmeasured points in a patch.

    Notes
    -----
    What is odd and yet may be right is logged as a warning.
    """
    problems: list[GstError] = []
    facts_of_mesh = heights = None
    try:
        if mesh is not None:
            stone = read_mesh(mesh, unit=mesh_unit)
            facts_of_mesh = mesh_facts(stone)
            heights = _square(stone, mesh, mesh_unit, square, macroscale)
    except GstError as error:
        problems.append(error)
    rows, ranges = [], []
    pieces: dict[tuple[str, str], _Piece] = {}
    held: dict[float, dict[Path, float]] = {}
    by_file: dict[Path, list[ScanFile]] = {}
    for scan in scans:
        by_file.setdefault(scan.path, []).append(scan)
    for path, uses in by_file.items():
        try:
            whole = read_scan(path, **read_settings(scan_settings))
        except GstError as error:
            problems.append(error)
            continue
        if (height := held_height(whole)) is not None:
            held.setdefault(height[0], {})[path] = height[1]
        for use in uses:
            try:
                piece = _piece(whole, use, scan_settings["size_mm"], maximum_unmeasured)
            except InputError as error:
                problems.append(InputError(_named(use), error.problem, error.remedy))
                continue
            facts = scan_facts(piece)
            pieces[use.patch, use.epoch] = _Piece.of(piece, path)
            ranges.append(facts["highest_um"] - facts["lowest_um"])
            rows.append(
                {"patch": use.patch, "epoch": use.epoch, "file": path.name}
                | {name: facts.get(name) for name in _FACTS}
            )
    _warn_of_held_heights(held)
    problems += _unequal_spacings(pieces)
    problems += _unlike_counterface(pieces)
    problems += _same_at_both_epochs(pieces)
    _warn_of_same_patches(pieces)
    columns = ["patch", "epoch", "file", *_FACTS]
    return Inputs(
        scans=pd.DataFrame(rows, columns=columns),
        ranges_um=tuple(ranges),
        mesh=facts_of_mesh,
        square=heights,
        problems=tuple(problems),
    )


def _square(stone, mesh, unit, square, macroscale) -> xr.DataArray:
    gridded = grid_mesh(
        stone,
        find_frame(square, stone, unit=unit, source=str(mesh)),
        size_mm=square["size_mm"],
        shape=(macroscale["grid"], macroscale["grid"]),
        margin_mm=macroscale["margin_mm"],
        source=str(mesh),
    )
    return remove_plane(gridded)[0]


def _warn_of_held_heights(held: Mapping[float, Mapping[Path, float]]) -> None:
    """Name the heights that stand for unmeasured points, as they seem to, once for all scans."""
    for height, shares in held.items():
        first, *others = shares
        _log.warning(
            "%s%s: up to %.3g %% of the points of a scan have one height, %g µm. If that stands "
            "for unmeasured points, export them as empty cells or NaN",
            first,
            f" and {len(others)} more" if others else "",
            100 * max(shares.values()),
            height,
        )


def _piece(whole, use: ScanFile, size_mm, maximum_unmeasured) -> xr.DataArray:
    """What the study uses of a scan."""
    if use.crop is None:
        check_size(whole, size_mm)
        piece = whole
    else:
        piece = cut_scan(whole, use.crop, size_mm)
    check_unmeasured(piece, maximum_unmeasured)
    return piece


def _named(use: ScanFile) -> str:
    """The file, and what it is of: files in two folders may have one name."""
    what = f"patch {use.patch} at {use.epoch}" if use.epoch else use.patch
    return f"{use.path} ({what})"


def _both_epochs(pieces: Mapping) -> Iterable[tuple[str, _Piece, _Piece]]:
    """Patch, its piece at T0 and that at T1, where both could be read."""
    for (patch, epoch), piece in pieces.items():
        if epoch == "T1" and (patch, "T0") in pieces:
            yield patch, pieces[patch, "T0"], piece


def _unequal_spacings(pieces: Mapping) -> list[InputError]:
    """T1 is laid over T0 point by point, so both need the same spacing."""
    return [
        InputError(
            second.path,
            f"its points are {second.spacing[1] * 1e3:.5g} µm apart, those of {first.path} "
            f"{first.spacing[1] * 1e3:.5g} µm",
            "Scan both epochs of a patch with the same objective, or resample one.",
        )
        for _, first, second in _both_epochs(pieces)
        if max(abs(a / b - 1) for a, b in zip(second.spacing, first.spacing, strict=True))
        > _SAME_SPACING
    ]


def _unlike_counterface(pieces: Mapping) -> list[GstError]:
    """The counterface is laid over each patch at T0; the first that it does not fit is enough."""
    face = pieces.get(("counterface", ""))
    for (_, epoch), piece in pieces.items():
        if face is None or epoch != "T0":
            continue
        try:
            check_grid(
                (face.shape, face.spacing),
                (piece.shape, piece.spacing),
                source=face.path,
                patch_source=piece.path,
            )
        except GstError as error:
            return [error]
    return []


def _same_at_both_epochs(pieces: Mapping) -> list[InputError]:
    """Two scans never have the same noise: one of them was copied, and no wear would be found."""
    return [
        InputError(
            second.path,
            f"patch {patch} has the same heights at T1 as at T0"
            + (f" ({first.path})" if first.path != second.path else ", from this one file"),
            "Give the scan that was made after use, or leave t1 empty in the patch table.",
        )
        for patch, first, second in _both_epochs(pieces)
        if first.content == second.content
    ]


def _warn_of_same_patches(pieces: Mapping) -> None:
    same: dict[bytes, dict[str, Path]] = {}
    for (patch, epoch), piece in pieces.items():
        if epoch:
            same.setdefault(piece.content, {})[patch] = piece.path
    for files in same.values():
        if len(files) > 1:
            _log.warning(
                "patches %s have the same heights (%s): give each its own scan",
                ", ".join(files),
                ", ".join(map(str, dict.fromkeys(files.values()))),
            )
