"""A study from a mesh and a folder of scans: `gst new FOLDER --mesh M --scans S`.

It writes ``study.yaml`` and ``patches.csv``, and reports each inferred value with its source. The
scans are located with an overview map or the stage's places. Missing values are marked `TODO`, and
`gst check` refuses them.
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

from gst import ROOT
from gst.config.edited import with_values
from gst.config.patches import cell_of
from gst.config.reading import complete
from gst.config.strict_yaml import parse_yaml
from gst.config.todo import TODO, is_to_do, left_in
from gst.setup.scan_folder import (
    OTHER_SPACING,
    Pairs,
    Scan,
    pair_scans,
    read_scans,
    scans_in,
)
from gst.setup.scan_positions import (
    DOUBT,
    OK,
    SAME_SIZE,
    TO_DO,
    Line,
    default_square_mm,
    where_scanned,
)
from gstlib.errors import InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import (
    UNITS,
    is_closed,
    is_mesh,
    read_mesh,
    steps_of,
    units_of_size,
)
from gstlib.macroscale.face import largest_face
from gstlib.preprocess.use_face import Layout, find_use_face
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import frame_from_points

if TYPE_CHECKING:
    import trimesh

__all__ = ["new_study"]

# Columns of the listing.
_TOPIC, _WIDEST = 10, 90
# Rows, and files left out, that are named.
_SHOWN = 12
# Rays along the square by which its thickness is taken.
_RAYS = 50
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


class _Stone(NamedTuple):
    """The stone of the mesh, in mm."""

    mesh: "trimesh.Trimesh"
    unit: str  # or `TODO`
    line: Line


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
    config_path, table_path = folder / "study.yaml", folder / "patches.csv"
    if there := [path for path in (config_path, table_path) if path.exists()]:
        raise InputError(
            there[0], "exists already", "Name another folder, or remove it."
        )
    stone, table = _read_stone(mesh), ""
    lines = [stone.line]
    values: dict[str, Any] = {
        "results": "results",
        "title": folder.resolve().name,
        "inputs.mesh": _relative(mesh, folder),
        "inputs.mesh_unit": stone.unit,
        "square.points_mm": TODO,
        "square.size_mm": default_square_mm(),
    } | dict.fromkeys(_USE, TODO)
    if scans:
        more, table, of_scans = _from_scans(folder, stone, scans, overview, names)
        lines += of_scans
        values |= {"patches": table_path.name} | more
    else:
        values |= {"patches": None, "inputs.scan_folder": None, "gesture": _GESTURE}
        text = "none: the study proposes positions to scan, for a load point that scatters by 1 mm"
        lines.append(Line("Scans", text, DOUBT))
    face_mm, of_face = _face(stone, values)
    values = {"macroscale.face_mm": face_mm} | values
    use = "force, active tool and rocks: the files do not contain them"
    lines += [of_face, Line("Use", use, TO_DO)]
    text = _template(values, [line.text for line in lines if line.state == TO_DO])
    if table:
        write_whole(table_path, table.encode())
    write_whole(config_path, text.encode())
    wide = min(_WIDEST, max(len(line.text) for line in lines))
    listed = [
        f"  {topic:<{_TOPIC}}{text:<{wide}}  {state}" for topic, text, state in lines
    ]
    return "".join(f"{line.rstrip()}\n" for line in listed) + _what_next(
        folder, table, text
    )


def _relative(path: Path, folder: Path) -> str:
    """A path from the folder of the study."""
    return os.path.relpath(path.resolve(), folder.resolve())


def _read_stone(path: Path) -> _Stone:
    """The mesh in mm, and in which unit it is: the file's own, or the one that makes a stone."""
    mesh = _read_in_any_unit(path)
    unit = mesh.metadata["file_unit"]
    sides = mesh.extents / UNITS[unit]
    shown = " × ".join(f"{side:.4g}" for side in sides)
    fitting = units_of_size(float(max(sides)))
    if mesh.metadata["states_unit"]:
        text = f"{shown} {unit}, as the file states"
    elif len(fitting) == 1:
        if fitting != [unit]:
            (unit,) = fitting
            mesh = read_mesh(path, unit=unit)
        text = f"{shown} → {unit} (only {unit} makes a hand-sized stone)"
    else:
        sizes = [f"{max(sides) * UNITS[each]:.3g} mm ({each})" for each in fitting]
        text = f"{shown}, without a unit: is the stone {' or '.join(sizes)} long?"
        return _Stone(mesh, TODO, Line("Mesh", text, TO_DO))
    text += f", coordinates in {steps_of(mesh)}"
    return _Stone(mesh, unit, Line("Mesh", text, OK))


def _read_in_any_unit(path: Path) -> "trimesh.Trimesh":
    """The mesh in the unit that it states or in mm, or else in the first in which it can be."""
    try:
        return read_mesh(path)
    except InputError:
        for unit in UNITS:
            with contextlib.suppress(InputError):
                return read_mesh(path, unit=unit)
        raise


def _face(stone: _Stone, values: Mapping[str, Any]) -> tuple[float, Line]:
    """The side of the face: the default, unless the stone is thinner under the square."""
    size_mm, corners = values["square.size_mm"], values["square.points_mm"]
    usual: float = max(complete({})["macroscale"]["face_mm"], size_mm)
    why = "the mesh does not show the stone's thickness under the square"
    if is_to_do(corners):
        why = "gst check reports the thickness under the square once it is placed"
    elif not is_closed(stone.mesh):
        why = "the mesh does not have an underside, so the thickness is unknown"
    else:
        with contextlib.suppress(InputError):
            frame, layout = frame_from_points(corners), Layout(size_mm, _RAYS, 0)
            face = find_use_face(stone.mesh, frame, layout, source=stone.line.text)
            side = largest_face(face.thickness)
            why = f"the stone is {side:g} mm thick under the square"
            if side < usual:
                usual = max(size_mm, side)
                state = OK if size_mm <= side else DOUBT
                return usual, Line("Face", f"{usual:g} mm, as {why}", state)
    state = OK if why.startswith("the stone") else DOUBT
    return usual, Line("Face", f"{usual:g} mm, the default: {why}", state)


def _from_scans(
    folder: Path,
    stone: _Stone,
    paths: Sequence[Path],
    overview: Path | None,
    names: str | None,
) -> tuple[dict[str, Any], str, list[Line]]:
    """Values of the config, the patch table, and lines of the listing."""
    root, files, others = scans_in(paths)
    scans, faults = read_scans(
        root, [path for path in files if overview is None or path != overview.resolve()]
    )
    if not scans:
        raise InputError(
            root,
            f"does not contain a scan that can be read: {faults[0]}",
            "Export them again.",
        )
    pairs = pair_scans(scans, names)
    by_name = {scan.name: scan for scan in scans if scan not in pairs.overviews}
    first = {row.patch: by_name.get(row.t0) for row in pairs.rows}
    units, of_units = _units([*by_name.values()])
    before = [scan for scan in first.values() if scan is not None]
    sizes, is_cut, of_sizes = _sizes(before or [*by_name.values()], units)
    overviews = pairs.overviews if overview is None else _read_overview(overview)
    mesh = None if is_to_do(stone.unit) else stone.mesh
    where = where_scanned(mesh, first, overviews, pairs.invert, sizes["scans.size_mm"])
    values = units | sizes | {"inputs.scan_folder": _relative(root, folder)}
    values["scans.mould.invert"] = pairs.invert
    values["scans.mould.flip"] = "x" if pairs.invert is True else None
    values |= where.values
    lines = [of_units, *of_sizes, *_of_pairs(pairs)]
    if is_to_do(values["scans.mould.invert"]) == is_to_do(
        pairs.invert
    ):  # else the mesh shows it
        state = TO_DO if is_to_do(pairs.invert) else OK
        lines.append(Line("Mould", pairs.mould, state))
    lines += where.lines
    lines += [
        Line("Not read", fault.removeprefix(f"{root}/"), DOUBT) for fault in faults
    ]
    left = [*pairs.left, *(path.relative_to(root).as_posix() for path in others)]
    left = [name for name in left if not is_mesh(name)]
    if left:
        text = ", ".join(left[:_SHOWN]) + f", … ({len(left)} files)" * (
            len(left) > _SHOWN
        )
        lines.append(Line("Left out", text))
    return values, _table(pairs, where.places, is_cut=is_cut), lines


def _read_overview(path: Path) -> list[Scan]:
    """The map that is named as the overview."""
    scans, faults = read_scans(path.resolve().parent, [path.resolve()])
    if faults:
        raise InputError(path, f"cannot be read: {faults[0]}", "Correct --overview.")
    return scans


def _units(scans: Sequence[Scan]) -> tuple[dict[str, Any], Line]:
    """The unit of files that do not state it, and the spacing if the files do not state it."""
    units, count = {scan.unit for scan in scans} - {None}, f"{len(scans)} files"
    if TODO in units or len(units) > 1:
        text = f"{count}; some state neither unit nor spacing: please enter both"
        return {"scans.unit": TODO, "scans.spacing_um": TODO}, Line(
            "Scans", text, TO_DO
        )
    unit = units.pop() if units else None
    sizes = {
        f"{width:.3g} × {height:.3g}" for height, width in (s.size_mm for s in scans)
    }
    steps = {f"{1e3 * scan.spacing_mm[1]:.3g}" for scan in scans}
    stated = f"{unit} (only {unit} makes such a field)" if unit else "unit stated"
    text = f"{' and '.join(sorted(sizes))} mm, every {' and '.join(sorted(steps))} µm, {stated}"
    return {"scans.unit": unit}, Line("Scans", f"{count}, {text}", OK)


def _sizes(
    scans: Sequence[Scan], units: dict[str, Any]
) -> tuple[dict[str, Any], bool, list[Line]]:
    """The side of the patches, and whether they are cut from the scans before use."""
    if (
        units["scans.unit"] == TODO
    ):  # the side of points without a spacing follows from other scans
        sides = [side for scan in scans if scan.unit != TODO for side in scan.size_mm]
        likely = f"{TODO} {np.mean(sides):.3g}" if sides and _are_same(sides) else TODO
        return {"scans.size_mm": likely}, False, []
    sides = [side for scan in scans for side in scan.size_mm]
    if _are_same(sides):
        return {"scans.size_mm": float(f"{np.mean(sides):.3g}")}, False, []
    size_mm = math.floor(1e3 * min(sides)) / 1e3
    if _are_same([min(scan.size_mm) for scan in scans]):
        text = f"not all are square: the middle {size_mm:g} mm of each scan before use are taken"
        return {"scans.size_mm": size_mm}, True, [Line("", text, DOUBT)]
    text = f"the scans differ in size: is {size_mm:g} mm the side of all patches?"
    return {"scans.size_mm": f"{TODO} {size_mm:g}"}, True, [Line("", text, TO_DO)]


def _are_same(sides: Sequence[float]) -> bool:
    return max(sides) - min(sides) <= SAME_SIZE * min(sides)


def _of_pairs(pairs: Pairs) -> Iterator[Line]:
    """The lines on scans that belong together, with reasons and questions."""
    wide = [max(map(len, column)) for column in zip(*pairs.rows, strict=True)]
    for row, evidence in list(zip(pairs.rows, pairs.evidence, strict=True))[:_SHOWN]:
        cells = [
            f"{cell:<{width}}" for cell, width in zip(row, wide, strict=True) if width
        ]
        state = TO_DO if TODO in "".join(row) else DOUBT if ";" in evidence else OK
        yield Line("", "  ".join([*cells, evidence]), state)
    if len(pairs.rows) > _SHOWN:
        yield Line("", f"… and {len(pairs.rows) - _SHOWN} more")
    again = sum(bool(row.repeat) for row in pairs.rows)
    after = sum(row.t1 not in ("", TODO) for row in pairs.rows)
    text = f"{len(pairs.rows)} patches, {after} with a scan after use, {again} scanned twice"
    yield Line("", f"{text}; {pairs.earlier}" if pairs.earlier else text, OK)
    if any(evidence.endswith(OTHER_SPACING) for evidence in pairs.evidence):
        text = (
            "scans before and after use differ in spacing and cannot be compared: scan "
            "both with the same objective, or resample one in your instrument's software"
        )
        yield Line("", text, TO_DO)
    for question in pairs.questions:
        yield Line("", question, TO_DO)
    for overview in pairs.overviews:
        height, width = overview.size_mm
        text = f"{overview.name}, {width:.3g} × {height:.3g} mm, is a map of several patches"
        yield Line("Overview", text, DOUBT)


def _table(pairs: Pairs, places: Mapping[str, PatchPosition], *, is_cut: bool) -> str:
    """The patch table. Semicolons leave room for decimal commas."""
    columns = ["patch", "x_mm", "y_mm"]
    columns += ["rotation_deg"] * any(place.rotation_deg for place in places.values())
    columns += ["t0", "t1"] + ["repeat"] * any(row.repeat for row in pairs.rows)
    columns += ["crop_x_mm", "crop_y_mm"] * is_cut
    lines = []
    for row in pairs.rows:
        cells: dict[str, Any] = {"patch": row.patch, "crop_x_mm": 0, "crop_y_mm": 0}
        cells |= {"x_mm": TODO, "y_mm": TODO, "rotation_deg": 0}
        if place := places.get(row.patch):
            cells |= {name: round(value, 4) for name, value in place._asdict().items()}
        cells |= {name: cell_of(getattr(row, name)) for name in ("t0", "t1", "repeat")}
        lines.append({column: cells[column] for column in columns})
    return pd.DataFrame(lines, columns=columns).to_csv(
        sep=";", index=False, lineterminator="\n"
    )


def _template(values: dict[str, Any], questions: Sequence[str]) -> str:
    """The shipped config for an own stone, with these values, and the questions above."""
    own = (ROOT / "config/own.yaml").read_text(encoding="utf-8")
    head = own.index("\nresults:")
    body = (
        own[head:].replace(".venv/bin/gst", "gst").replace("data/own/mesh.stl", "MESH")
    )
    lines = textwrap.TextWrapper(98, initial_indent="# - ", subsequent_indent="#   ")
    asked = "".join(f"{lines.fill(question)}\n" for question in questions)
    text = _HEAD + asked + with_values(body, values)
    if "uncertainty.placement_um" in values:  # comes last
        text = f"{text.rstrip()}  # of the positions found by heights\n"
    return text


def _what_next(folder: Path, table: str, text: str) -> str:
    """The files that were written, the number of missing values, and the next commands."""
    left, cells = len([*left_in(parse_yaml(text, "study.yaml"), {})]), table.count(TODO)
    written = f"  wrote {folder / 'study.yaml'} ({left} {TODO})"
    written += f" and {folder / 'patches.csv'} ({cells} {TODO})" * bool(table)
    place = shlex.join(["gst", "place", str(folder)])
    return (
        f"{written}\n"
        f"  ({OK}: read from the files; {DOUBT}: a default or a doubt; {TO_DO}: still {TODO})\n"
        f"\nNext:\n  {place}\n"
        "  (opens a page to place the scans, describe the use, check and run;\n"
        f"  or replace each {TODO} by hand, then run gst check and gst study)\n"
    )
