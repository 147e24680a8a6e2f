"""A study from a mesh and a folder of scans: `gst new FOLDER --mesh M --scans S`.

It writes ``study.yaml`` and ``patches.csv``, and reports each inferred value with its source. Then
it looks for the positions of the scans as the page of `gst place` does. Missing values are marked
`TODO`, and `gst check` refuses them.
"""

import contextlib
import math
import os
import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.distance import pdist

from gst import ROOT
from gst.config.edited import with_values
from gst.config.patches import cell_of
from gst.config.reading import complete, read_config, read_unfinished, values_to_do
from gst.config.todo import TODO, is_to_do
from gst.setup.place_scans import find_places, stages_of
from gst.setup.place_state import save_answers, save_places, state_of
from gst.setup.scan_folder import Pairs, Scan, pair_scans, read_scans, scans_in
from gstlib.errors import InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import UNITS, is_mesh, read_mesh, steps_of, units_of_size

if TYPE_CHECKING:
    import trimesh


_OK, _DOUBT, _TO_DO = "ok", "look", "to do"
# Sides of a patch that differ by less are equal: as `gstlib.io.scans.cut_scan` has it.
_SAME_SIZE = 0.01
# ASSUME: Least distance of scan positions. Scans of different patches share at most half of their
# side. Reason: If stage coordinates are closer, they were not recorded, or the stone was moved
# between the scans.
_LEAST_APART = 0.5
_CONFIG, _TABLE = "study.yaml", "patches.csv"
# Columns of the listing.
_TOPIC, _WIDEST = 10, 90
# Rows, and files left out, that are named.
_SHOWN = 12
# How the load point scatters where the study proposes places to scan, as in config/mesh_only.yaml.
_GESTURE = {"load_point_scatter_mm": 1.0, "poses": 60}
# Values that only the user can give.
_USE = (
    "load.force_N",
    "counterface.radius_mm",
    "material.young_1_MPa",
    "material.young_2_MPa",
)
_HEAD = """\
# Made by `gst new` from the files that it names. Values that begin with TODO are missing, and
# `gst check` lists them. Paths are relative to this folder. All other keys have their defaults.
# The steps are described in docs/how-to/your-own-tool.md.
"""


class _Line(NamedTuple):
    """A line of the listing."""

    topic: str
    text: str
    state: str = ""


def new_study(
    folder: Path,
    mesh: Path,
    scans: Sequence[Path],
    overview: Path | None = None,
    names: str | None = None,
) -> str:
    """Write a study into a folder; returns the inferred values, their sources and the missing ones.

    An `overview` is a map of the face that holds the scanned places; among the scans, the one that
    is much larger than the others is taken for it. `names` is the pattern of the scans' names, as
    `gst.setup.file_names.read_names` has it. Raises an `InputError` if a file cannot be read, or
    the folder has a study.
    """
    for path in (folder / _CONFIG, folder / _TABLE):
        if path.exists():
            remedy = "Name another folder, or remove it."
            raise InputError(path, "exists already", remedy)
    unit, line = _unit_of_mesh(mesh)
    lines = [line]
    values: dict[str, Any] = {
        "results": "results",
        "title": folder.resolve().name,
        "inputs.mesh": _relative(mesh, folder),
        "inputs.mesh_unit": unit,
        "square.points_mm": TODO,
        "square.size_mm": complete({})["square"]["size_mm"],
    } | dict.fromkeys(_USE, TODO)
    table, pairs = "", None
    if scans:
        of_scans, pairs, listed = _from_scans(folder, scans, overview, names)
        table = _table(pairs, is_cut=of_scans.pop("is_cut"))
        values |= {"patches": _TABLE} | of_scans
        lines += listed
    else:
        values |= {"patches": None, "inputs.scan_folder": None, "gesture": _GESTURE}
        text = "none: the study proposes positions to scan, for a load point that scatters by 1 mm"
        lines.append(_Line("Scans", text, _DOUBT))
    own = (ROOT / "config/own.yaml").read_text(encoding="utf-8")
    body = own[own.index("\nresults:") :].replace(".venv/bin/gst", "gst")
    body = with_values(body.replace("data/own/mesh.stl", "MESH"), values)
    if table:
        write_whole(folder / _TABLE, table.encode())
    write_whole(folder / _CONFIG, f"{_HEAD}{body}".encode())
    if pairs is not None:
        lines += _positions(folder, pairs, overview)
    use = "force, active tool and rocks: the files do not contain them"
    lines.append(_Line("Use", use, _TO_DO))
    _ask(folder / _CONFIG, [line.text for line in lines if line.state == _TO_DO])
    return _listing(lines) + _what_next(folder)


def _relative(path: Path, folder: Path) -> str:
    """A path from the folder of the study."""
    return os.path.relpath(path.resolve(), folder.resolve())


def _unit_of_mesh(path: Path) -> tuple[str, _Line]:
    """The unit of the mesh: the file's own, or the one that makes a stone; or `TODO`."""
    mesh = _read_in_any_unit(path)
    unit = mesh.metadata["file_unit"]
    sides = mesh.extents / UNITS[unit]
    shown = " × ".join(f"{side:.4g}" for side in sides)
    fitting = units_of_size(float(max(sides)))
    if mesh.metadata["states_unit"]:
        text = f"{shown} {unit}, as the file states"
    elif len(fitting) == 1:
        (unit,) = fitting
        mesh = read_mesh(path, unit=unit)
        text = f"{shown} → {unit} (only {unit} makes a hand-sized stone)"
    else:
        sizes = [f"{max(sides) * UNITS[each]:.3g} mm ({each})" for each in fitting]
        text = f"{shown}, without a unit: is the stone {' or '.join(sizes)} long?"
        return TODO, _Line("Mesh", text, _TO_DO)
    return unit, _Line("Mesh", f"{text}, coordinates in {steps_of(mesh)}", _OK)


def _read_in_any_unit(path: Path) -> "trimesh.Trimesh":
    """The mesh in the unit that it states or in mm, or else in the first in which it can be."""
    try:
        return read_mesh(path)
    except InputError:
        for unit in UNITS:
            with contextlib.suppress(InputError):
                return read_mesh(path, unit=unit)
        raise


def _from_scans(
    folder: Path, paths: Sequence[Path], overview: Path | None, names: str | None
) -> tuple[dict[str, Any], Pairs, list[_Line]]:
    """Values of the config, the scans that belong together, and lines of the listing."""
    root, files, others = scans_in(paths)
    scans, faults = read_scans(
        root, [path for path in files if overview is None or path != overview.resolve()]
    )
    if not scans:
        problem = f"does not contain a scan that can be read: {faults[0]}"
        raise InputError(root, problem, "Export them again.")
    pairs = pair_scans(scans, names)
    usual = [scan for scan in scans if scan not in pairs.overviews]
    units, of_units = _units(usual)
    sizes, of_sizes = _sizes([*pairs.before.values()] or usual)
    values = units | sizes | {"inputs.scan_folder": _relative(root, folder)}
    values["scans.mould.invert"] = pairs.invert
    values["scans.mould.flip"] = "x" if pairs.invert is True else None
    lines = [of_units, *of_sizes, *_of_pairs(pairs)]
    for fault in faults:
        lines.append(_Line("Not read", fault.removeprefix(f"{root}/"), _DOUBT))
    left = [*pairs.left, *(path.relative_to(root).as_posix() for path in others)]
    left = [name for name in left if not is_mesh(name)]
    if left:
        more = f", … ({len(left)} files)" * (len(left) > _SHOWN)
        lines.append(_Line("Left out", ", ".join(left[:_SHOWN]) + more))
    return values, pairs, lines


def _units(scans: Sequence[Scan]) -> tuple[dict[str, Any], _Line]:
    """The unit of files that do not state it, and the spacing if the files do not state it."""
    units, count = {scan.unit for scan in scans} - {None}, f"{len(scans)} files"
    if TODO in units or len(units) > 1:
        text = f"{count}; some state neither unit nor spacing: please enter both"
        values = {"scans.unit": TODO, "scans.spacing_um": TODO}
        return values, _Line("Scans", text, _TO_DO)
    unit = units.pop() if units else None
    sizes = {f"{scan.size_mm[1]:.3g} × {scan.size_mm[0]:.3g}" for scan in scans}
    steps = {f"{1e3 * scan.spacing_mm[1]:.3g}" for scan in scans}
    stated = f"{unit} (only {unit} makes such a field)" if unit else "unit stated"
    text = f"{' and '.join(sorted(sizes))} mm, every {' and '.join(sorted(steps))} µm, {stated}"
    return {"scans.unit": unit}, _Line("Scans", f"{count}, {text}", _OK)


def _sizes(scans: Sequence[Scan]) -> tuple[dict[str, Any], list[_Line]]:
    """The side of the patches, and whether they are cut from the scans before use."""
    sized = [scan.size_mm for scan in scans if scan.unit != TODO]
    is_sized = len(sized) == len(scans)
    if not sized:
        return {"scans.size_mm": TODO, "is_cut": False}, []
    shorter = [min(size) for size in sized]
    is_cut = not _are_same([side for size in sized for side in size])
    side = (
        f"{math.floor(1e3 * min(shorter)) / 1e3:g}"
        if is_cut
        else f"{np.mean(sized):.3g}"
    )
    lines = []
    if is_cut and _are_same(shorter):
        text = f"not all are square: the middle {side} mm of each scan before use are taken"
        lines = [_Line("", text, _DOUBT)]
    elif is_cut:
        text = f"the scans differ in size: is {side} mm the side of all patches?"
        lines, is_sized = [_Line("", text, _TO_DO)], False
    value = float(side) if is_sized else f"{TODO} {side}"
    return {"scans.size_mm": value, "is_cut": is_cut}, lines


def _are_same(sides: Sequence[float]) -> bool:
    return max(sides) - min(sides) <= _SAME_SIZE * min(sides)


def _of_pairs(pairs: Pairs) -> Iterator[_Line]:
    """The lines on scans that belong together, with reasons and questions."""
    wide = [max(map(len, column)) for column in zip(*pairs.rows, strict=True)]
    for row, evidence in list(zip(pairs.rows, pairs.evidence, strict=True))[:_SHOWN]:
        cells = [
            f"{cell:<{width}}" for cell, width in zip(row, wide, strict=True) if width
        ]
        state = _TO_DO if TODO in "".join(row) else _DOUBT if ";" in evidence else _OK
        yield _Line("", "  ".join([*cells, evidence]), state)
    if len(pairs.rows) > _SHOWN:
        yield _Line("", f"… and {len(pairs.rows) - _SHOWN} more")
    again = sum(bool(row.repeat) for row in pairs.rows)
    after = sum(row.t1 not in ("", TODO) for row in pairs.rows)
    text = f"{len(pairs.rows)} patches, {after} with a scan after use, {again} scanned twice"
    yield _Line("", f"{text}; {pairs.earlier}" if pairs.earlier else text, _OK)
    for question in pairs.questions:
        yield _Line("", question, _TO_DO)
    for overview in pairs.overviews:
        height, width = overview.size_mm
        text = f"{overview.name}, {width:.3g} × {height:.3g} mm, is a map of several patches"
        yield _Line("Overview", text, _DOUBT)


def _table(pairs: Pairs, *, is_cut: bool) -> str:
    """The patch table. Semicolons leave room for decimal commas."""
    rows = pd.DataFrame(pairs.rows)
    rows.insert(1, "x_mm", TODO)
    rows.insert(2, "y_mm", TODO)
    scans = rows.columns[3:]
    rows[scans] = rows[scans].map(cell_of)
    if not rows["repeat"].any():
        rows = rows.drop(columns="repeat")
    if is_cut:
        rows = rows.assign(crop_x_mm=0, crop_y_mm=0)
    return rows.to_csv(sep=";", index=False, lineterminator="\n")


def _positions(folder: Path, pairs: Pairs, overview: Path | None) -> list[_Line]:
    """Write the positions of the scans, and return their lines and that of the mould."""
    state = _TO_DO if is_to_do(pairs.invert) else _OK
    mould = _Line("Mould", pairs.mould, state)
    path, overview = Path(_CONFIG), overview and overview.resolve()
    with contextlib.chdir(folder):
        try:
            found = find_places(path, overview)
        except InputError as error:
            return [mould, _by_stage(path, pairs, error.problem)]
        answers = found["answers"]
        inverted = answers.get("scans.mould.invert")
        if inverted is not None and is_to_do(pairs.invert):
            way = "inverted, as moulds" if inverted else "as it was scanned"
            mould = _Line("Mould", f"the scanned surface fits the mesh {way}", _OK)
        elif inverted is not None:
            answers["scans.mould.invert"] = f"{TODO} {str(inverted).lower()}"
            text = (
                f"{pairs.mould}, but the mesh indicates the opposite: which is right?"
            )
            mould = _Line("Mould", text, _TO_DO)
        _save(path, found["square"], found["places"])
        save_answers(path, answers)
    placed = {place["patch"] for place in found["places"]}
    lines = [mould, _Line("Where", found["all"], _OK if placed else _TO_DO)]
    for patch, fit in found["fits"].items():
        state = _OK if patch in placed else _TO_DO
        lines.append(_Line("", f"{patch}: {fit}", state))
    return lines


def _by_stage(path: Path, pairs: Pairs, problem: str) -> _Line:
    """Write distances of patches, in the middle of a square that is still to be laid."""
    square = state_of(path)["square"]
    size_mm = read_unfinished(path)["scans"]["size_mm"]
    scans = [*pairs.before.values()]
    stages = stages_of(scans)
    if stages is None or is_to_do(size_mm) or not _are_apart(scans, size_mm):
        return _Line(
            "Where", f"the study {problem}: please enter x_mm and y_mm", _TO_DO
        )
    # a mould is seen from behind
    at = np.asarray(stages) * ((-1, 1) if pairs.invert is True else (1, 1))
    span = float(np.ptp(at, axis=0).max()) + size_mm
    # in halves of a millimetre
    square["size_mm"] = max(square["size_mm"], math.ceil(2 * span) / 2)
    at += (square["size_mm"] - at.min(axis=0) - at.max(axis=0)) / 2
    _save(
        path,
        square,
        [
            {"patch": patch, "x_mm": x, "y_mm": y}
            for patch, (x, y) in zip(pairs.before, at.tolist(), strict=True)
        ],
    )
    text = (
        f"by the stage, over {span:.3g} mm; no file contains the direction of its axes"
    )
    return _Line("Where", text, _DOUBT)


def _are_apart(scans: Sequence[Scan], size_mm: float) -> bool:
    """Whether the stage positions of maps of one size are those of different patches."""
    places = pd.DataFrame([scan.stage_mm for scan in scans])
    sizes = pd.DataFrame([scan.size_mm for scan in scans])
    apart = pdist(places, "chebyshev").min() >= _LEAST_APART * size_mm
    return bool(apart and (np.ptp(sizes, axis=0) <= _SAME_SIZE * sizes.min()).all())


def _save(path: Path, square: Mapping, places: Sequence[Mapping]) -> None:
    by_patch = {place["patch"]: place for place in places}
    rows = state_of(path)["patches"]
    save_places(path, square, [row | by_patch.get(row["patch"], {}) for row in rows])


def _ask(config: Path, questions: Sequence[str]) -> None:
    """Write the questions above the config."""
    lines = textwrap.TextWrapper(98, initial_indent="# - ", subsequent_indent="#   ")
    asked = "".join(f"{lines.fill(question)}\n" for question in questions)
    text = config.read_text(encoding="utf-8")
    write_whole(config, text.replace(_HEAD, f"{_HEAD}{asked}", 1).encode())


def _listing(lines: Sequence[_Line]) -> str:
    wide = min(_WIDEST, max(len(line.text) for line in lines))
    listed = [
        f"  {topic:<{_TOPIC}}{text:<{wide}}  {state}" for topic, text, state in lines
    ]
    return "".join(f"{line.rstrip()}\n" for line in listed)


def _what_next(folder: Path) -> str:
    """The files that were written, the number of missing values, and the next commands."""
    config, table = folder / _CONFIG, folder / _TABLE
    left = len(values_to_do(read_config(config)))
    written = f"  wrote {config} ({left} {TODO})"
    if table.exists():
        written += f" and {table} ({table.read_text('utf-8').count(TODO)} {TODO})"
    place = shlex.join(["gst", "place", str(folder)])
    return (
        f"{written}\n"
        f"  ({_OK}: read from the files; {_DOUBT}: a default or a doubt; {_TO_DO}: still {TODO})\n"
        f"\nNext:\n  {place}\n"
        "  (opens a page to place the scans, describe the use, check and run;\n"
        f"  or replace each {TODO} by hand, then run gst check and gst study)\n"
    )
