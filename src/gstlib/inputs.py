"""Reads the files of a study before any work: what each holds, and all that is wrong with them.

A study of hours must not end at its last scan. A fault in one file does not keep the others from
being checked, so that all can be put right at once.
"""

import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import check_grid
from gstlib.errors import GstError, InputError
from gstlib.io.meshes import is_mesh, read_mesh, stated_unit
from gstlib.io.scans import check_size, cut_scan, read_scan, read_settings
from gstlib.preprocess.frame import Frame, find_frame
from gstlib.preprocess.gridding import grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.preprocess.scan import check_unmeasured
from gstlib.surface import spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = ["Inputs", "ScanFile", "check_inputs", "inspect_file"]

_log = logging.getLogger(__name__)

_MM_TO_UM = 1e3
_FACTS = (
    "points_x", "points_y", "spacing_x_um", "spacing_y_um", "unmeasured", "Sq_um", "tilt_x_mrad",
    "tilt_y_mrad", "instrument", "objective",
)  # fmt: skip
# Spacings of T0 and T1 that differ by more than this share are of two magnifications.
_SAME_SPACING = 1e-3
# One height at more than this share of the points, and at so many times the points of any other,
# was written, not measured: of heights in few steps, each is about as frequent as the next.
_HELD_SHARE, _HELD_TIMES = 1e-3, 10


@dataclass(frozen=True)
class ScanFile:
    """A scan that the study uses.

    Attributes
    ----------
    path : Path
    patch : str
        Patch, or "counterface".
    epoch : str
        T0, T1, or empty.
    crop : (x, y) or None
        Centre (mm) of the piece to cut, from the scan's centre; None for the whole scan.
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
        A row for each readable scan: ``patch, epoch, file``; ``points_x, points_y, spacing_x_um,
        spacing_y_um``; ``unmeasured`` (share); ``Sq_um, tilt_x_mrad, tilt_y_mrad`` about and of the
        least-squares plane; ``instrument, objective``; ``range_um``, of the heights as read.
    mesh : dict or None
        Vertices, faces, size, mean edge and state of the mesh; None if it cannot be read.
    stone : trimesh.Trimesh or None
        The mesh itself, mm.
    frame : Frame or None
        Where the square lies on it; None if there is no mesh, or if the config gives no frame.
    square : (ny, nx) xarray.DataArray or None
        Heights of the analysed square (mm), its plane removed; None if it cannot be had.
    problems : tuple of GstError
        Everything that would stop the study.
    """

    scans: pd.DataFrame
    mesh: dict[str, Any] | None
    stone: "trimesh.Trimesh | None"
    frame: Frame | None
    square: xr.DataArray | None
    problems: tuple[GstError, ...]


# Of a scan, by patch and epoch: its file, its grid ((ny, nx), (dy, dx)) and a hash of its heights.
# Bytes that the contact of the whole square takes for each point, at its peak (measured at 3012²).
_BYTES = 170

_Pieces = dict[tuple[str, str], tuple[Path, tuple, int]]


def check_inputs(
    mesh: str | Path | None,
    scans: Iterable[ScanFile],
    *,
    mesh_unit: str,
    square: Mapping,
    macroscale: Mapping,
    scan_settings: Mapping,
    maximum_unmeasured: float,
    reference: bool,
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
    reference : bool
        Whether the whole square is pressed at the scans' resolution, which takes memory.

    Notes
    -----
    What is odd and yet may be right is logged as a warning.
    """
    problems: list[GstError] = []
    facts_of_mesh = stone = frame = heights = None
    try:
        if mesh is not None:
            stone = read_mesh(mesh, unit=mesh_unit)
            facts_of_mesh = _mesh_facts(stone)
            frame = find_frame(square, stone, unit=mesh_unit, source=str(mesh))
            gridded = grid_mesh(
                stone,
                frame,
                size_mm=square["size_mm"],
                shape=(macroscale["grid"], macroscale["grid"]),
                margin_mm=macroscale["margin_mm"],
                interpolation="linear",  # the fastest: it is to be looked at
                source=str(mesh),
            )
            heights = remove_plane(gridded.height)[0]
    except GstError as error:
        problems.append(error)
    rows: list[dict[str, Any]] = []
    pieces: _Pieces = {}
    by_file: dict[Path, list[ScanFile]] = {}
    for scan in scans:
        by_file.setdefault(scan.path, []).append(scan)
    for path, uses in by_file.items():
        try:
            whole = read_scan(path, **read_settings(scan_settings))
        except GstError as error:
            problems.append(error)
            continue
        _warn_of_held_height(path, whole)
        for use in uses:
            try:
                piece = whole
                if use.crop is None:
                    check_size(whole, scan_settings["size_mm"])
                else:
                    piece = cut_scan(whole, use.crop, scan_settings["size_mm"])
                check_unmeasured(piece, maximum_unmeasured)
            except InputError as error:
                named = f"{path} (patch {use.patch} at {use.epoch})" if use.epoch else path
                problems.append(InputError(named, error.problem, error.remedy))
                continue
            facts = _scan_facts(piece)
            grid = piece.shape, spacing_of(piece)
            pieces[use.patch, use.epoch] = path, grid, hash(piece.values.tobytes())
            rows.append(
                {"patch": use.patch, "epoch": use.epoch, "file": path.name}
                | {name: facts.get(name) for name in _FACTS}
                | {"range_um": facts["highest_um"] - facts["lowest_um"]}
            )
    if reference and rows:
        try:
            memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
            _check_memory(square["size_mm"], rows[0]["spacing_x_um"] * 1e-3, memory)
            _check_grids(pieces)
        except InputError as error:
            problems.append(error)
    return Inputs(
        scans=pd.DataFrame(rows, columns=["patch", "epoch", "file", *_FACTS, "range_um"]),
        mesh=facts_of_mesh,
        stone=stone,
        frame=frame,
        square=heights,
        problems=(*problems, *_unlike_epochs(pieces), *_unlike_counterface(pieces)),
    )


def _unlike_epochs(pieces: _Pieces) -> Iterator[GstError]:
    """Refuse epochs of a patch that cannot be compared: unequal spacings, or equal heights."""
    for patch in [patch for patch, epoch in pieces if epoch == "T1" and (patch, "T0") in pieces]:
        first, (_, spacing_0), content_0 = pieces[patch, "T0"]
        second, (_, spacing_1), content_1 = pieces[patch, "T1"]
        if not np.allclose(spacing_1, spacing_0, rtol=_SAME_SPACING, atol=0):
            yield InputError(
                second,
                f"its points are {spacing_1[1] * _MM_TO_UM:.5g} µm apart, those of {first} "
                f"{spacing_0[1] * _MM_TO_UM:.5g} µm",
                "Scan both epochs of a patch with the same objective, or resample one.",
            )
        # Two scans never have the same noise: one of them was copied, and would show no wear.
        if content_0 == content_1:
            yield InputError(
                second,
                f"patch {patch} has the same heights at T1 as at T0 ({first})",
                "Give the scan that was made after use, or leave t1 empty in the patch table.",
            )


def _unlike_counterface(pieces: _Pieces) -> list[GstError]:
    """Compare the counterface with each patch at T0; the first that it does not fit is enough."""
    if ("counterface", "") not in pieces:
        return []
    face, face_grid, _ = pieces["counterface", ""]
    for path, grid, _ in (pieces[key] for key in pieces if key[1] == "T0"):
        try:
            check_grid(face_grid, grid, source=face, patch_source=path)
        except GstError as error:
            return [error]
    return []


def _check_memory(square_mm: float, spacing_mm: float, available: int) -> None:
    """Refuse a contact of the whole square that needs more than the `available` bytes."""
    count = round(square_mm / spacing_mm)
    if (needed := _BYTES * count**2) > available:
        raise InputError(
            "config, reference_draws",
            f"the contact of the whole square at the scans' resolution has {count} × {count} "
            f"elements and needs {needed / 2**30:.1f} GiB of memory; there are "
            f"{available / 2**30:.1f} GiB",
            "Set reference_draws to null, or run the study on a larger machine.",
        )


def _check_grids(pieces: _Pieces) -> None:
    """Refuse T0 scans of different grids, where the whole square is pressed at theirs."""
    shapes = {
        grid[0]: (patch, path)
        for (patch, epoch), (path, grid, _) in pieces.items()
        if epoch == "T0"
    }
    if len(shapes) > 1:
        (one, (_, first)), (other, (patch, path)) = list(shapes.items())[:2]
        raise InputError(
            path,
            f"patch {patch} has {other[1]} × {other[0]} points, but {first} has "
            f"{one[1]} × {one[0]}: the contact of the whole square needs scans of one grid",
            "Scan all patches alike, or set reference_draws to null.",
        )


def _warn_of_held_height(path: Path, scan: xr.DataArray) -> None:
    """Warn where one height is too frequent to have been measured: it may stand for no height."""
    heights, counts = np.unique(scan.values[np.isfinite(scan.values)], return_counts=True)
    second, most = np.append([0], np.sort(counts))[-2:]
    if most > max(_HELD_SHARE * scan.size, _HELD_TIMES * second):
        _log.warning(
            "%s: %.3g %% of the points have one height, %g µm. If that stands for unmeasured "
            "points, export them as empty cells or NaN",
            *(path, 100 * most / scan.size, heights[np.argmax(counts)] * _MM_TO_UM),
        )


def inspect_file(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> tuple[dict[str, Any], "xr.DataArray | trimesh.Trimesh"]:
    """Facts about a scan or a mesh, and what to draw of it; errors as of their readers.

    Parameters
    ----------
    path : str or Path
    unit : str, optional
        Unit of a file that does not state it; of meshes, mm by default, of glTF (GLB) m.
    spacing_um : float, optional
        Spacing of the points of a scan that does not state it (text).

    Returns
    -------
    facts : dict
        ``unit`` (and who states it); points, spacing, size and heights of a scan, and what it
        tells of its instrument; vertices, faces, size and state of a mesh.
    content : (ny, nx) xarray.DataArray or trimesh.Trimesh
        mm: the scan without its plane, or the mesh.
    """
    if is_mesh(path):
        stated = stated_unit(path)
        said = "mm, the default: the format does not state it"
        if unit or stated:
            said = f"{unit}, as told" if unit else f"{stated}, as the format prescribes"
        mesh = read_mesh(path, unit=unit or stated or "mm")
        return {"unit": said} | _mesh_facts(mesh), mesh
    spacing_mm = None if spacing_um is None else spacing_um / _MM_TO_UM
    try:
        scan, said = read_scan(path, spacing_mm=spacing_mm), "in the file"
    except InputError:
        if unit is None:
            raise
        scan, said = read_scan(path, unit=unit, spacing_mm=spacing_mm), f"{unit}, as told"
    return {"unit": said} | _scan_facts(scan), remove_plane(scan)[0]


def _scan_facts(scan: xr.DataArray) -> dict[str, Any]:
    """What a scan (mm) holds as it was read; Sq is about the least-squares plane."""
    dy, dx = spacing_of(scan)
    ny, nx = scan.shape
    level, plane = remove_plane(scan)
    own = {name: value for name, value in scan.attrs.items() if name not in ("units", "long_name")}
    return {
        "points_x": nx,
        "points_y": ny,
        "spacing_x_um": dx * _MM_TO_UM,
        "spacing_y_um": dy * _MM_TO_UM,
        "size_x_mm": nx * dx,
        "size_y_mm": ny * dy,
        "unmeasured": float(1 - np.isfinite(scan.values).mean()),
        "lowest_um": float(np.nanmin(scan.values)) * _MM_TO_UM,
        "highest_um": float(np.nanmax(scan.values)) * _MM_TO_UM,
        "tilt_x_mrad": plane.tilt_x_mrad,
        "tilt_y_mrad": plane.tilt_y_mrad,
        "Sq_um": float(np.nanstd(level.values)) * _MM_TO_UM,
        **own,
    }


def _mesh_facts(mesh: "trimesh.Trimesh") -> dict[str, Any]:
    """Vertices, faces, size, mean edge and state of a mesh (mm)."""
    facts: dict[str, Any] = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    for axis, low, high in zip("xyz", *mesh.bounds.tolist(), strict=True):
        facts |= {f"size_{axis}_mm": high - low, f"centre_{axis}_mm": (low + high) / 2}
    return facts | {
        "mean_edge_mm": float(mesh.edges_unique_length.mean()),
        "bodies": int(mesh.body_count),
        "closed": "yes" if mesh.is_watertight else "no",
    }
