"""A study from a mesh and a folder of scans: `gst new FOLDER --mesh M --scans S`.

It writes ``study.yaml`` and ``patches.csv``, and says what was inferred and from what. Where the
scans lie is found with an overview map or the stage's places. What the files do not tell is marked
`TODO`, and `gst check` refuses it.
"""

import contextlib
import math
import os
import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
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
from gst.setup.place_matching import Found, corners_of, described, located, on_square
from gst.setup.scan_folder import OTHER_SPACING, Pairs, Scan, pair_scans, read_scans, scans_in
from gstlib.errors import InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import UNITS, is_closed, is_mesh, read_mesh, steps_of, units_of_size
from gstlib.macroscale.face import largest_face
from gstlib.preprocess.use_face import Layout, find_use_face
from gstlib.surfaces.footprints import Place
from gstlib.surfaces.frames import frame_from_points

if TYPE_CHECKING:
    import trimesh

__all__ = ["new_study"]

_OK, _DOUBT, _TO_DO = "ok", "look", "to do"
# Columns of the listing.
_TOPIC, _WIDEST = 10, 90
# Rows, and files left out, that are named.
_SHOWN = 12
# Rays along the square by which its thickness is taken.
_RAYS = 50
# Sides of a patch that differ by less are equal: as `gstlib.io.scans.cut_scan` has it.
_SAME_SIZE = 0.01
# ASSUME: two scans of different places have at most so much of their sides in common; stages that
# say more were not read, or the stone was moved between the scans.
_LEAST_APART = 0.5
# How the load point scatters where the study proposes places to scan, as in config/mesh_only.yaml.
_GESTURE = {"load_point_scatter_mm": 1.0, "poses": 60}
_HEAD = """\
# Made by `gst new` from the files that it names. A value that begins with TODO is yours to give:
# `gst check` lists what is left. Paths are relative to this folder. Keys not given here have their
# defaults; docs/how-to/your-own-tool.md has the steps.
"""


class _Line(NamedTuple):
    """A line of the listing."""

    topic: str
    text: str
    state: str = ""


class _Stone(NamedTuple):
    """The stone of the mesh, in mm."""

    mesh: "trimesh.Trimesh"
    unit: str  # or `TODO`
    line: _Line


def new_study(
    folder: Path,
    mesh: Path,
    scans: Sequence[Path],
    overview: Path | None = None,
    names: str | None = None,
) -> str:
    """Write a study into a folder; returns what was inferred, from what, and what is to be done.

    An `overview` is a map of the face that holds the scanned places; among the scans, the one that
    is much larger than the others is taken for it. `names` is the pattern of the scans' names, as
    `gst.setup.file_names.read_names` has it. Raises an `InputError` if a file cannot be read, or
    the folder has a study.
    """
    config_path, table_path = folder / "study.yaml", folder / "patches.csv"
    if there := [path for path in (config_path, table_path) if path.exists()]:
        raise InputError(there[0], "exists already", "Name another folder, or remove it.")
    stone, table = _read_stone(mesh), ""
    lines = [stone.line]
    values: dict[str, Any] = {
        "results": "results",
        "title": folder.resolve().name,
        "inputs.mesh": _relative(mesh, folder),
        "inputs.mesh_unit": stone.unit,
        "square.points_mm": TODO,
        "square.size_mm": _square_mm(),
    }
    if scans:
        more, table, of_scans = _from_scans(folder, stone, scans, overview, names)
        lines += of_scans
        values |= {"patches": table_path.name} | more
    else:
        values |= {"patches": None, "inputs.scan_folder": None, "gesture": _GESTURE}
        text = "none: the study proposes where to scan, for a load point that scatters by 1 mm"
        lines.append(_Line("Scans", text, _DOUBT))
    face_mm, of_face = _face(stone, values)
    values = {"macroscale.face_mm": face_mm} | values
    text = _template(values, [line.text for line in lines if line.state == _TO_DO])
    lines += [of_face, _of_use(text)]
    if table:
        write_whole(table_path, table.encode())
    write_whole(config_path, text.encode())
    wide = min(_WIDEST, max(len(line.text) for line in lines))
    listed = [f"  {topic:<{_TOPIC}}{text:<{wide}}  {state}" for topic, text, state in lines]
    return "".join(f"{line.rstrip()}\n" for line in listed) + _what_next(folder, table, text)


def _relative(path: Path, folder: Path) -> str:
    """A path from the folder of the study, absolute where there is no way between them."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.resolve().as_posix()


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
        text = f"{shown}, its unit not stated: is the stone {' or '.join(sizes)} long?"
        return _Stone(mesh, TODO, _Line("Mesh", text, _TO_DO))
    text += f", coordinates in {steps_of(mesh)}"
    return _Stone(mesh, unit, _Line("Mesh", text, _OK))


def _read_in_any_unit(path: Path) -> "trimesh.Trimesh":
    """The mesh in the unit that it states or in mm, or else in the first in which it can be."""
    try:
        return read_mesh(path)
    except InputError:
        for unit in UNITS:
            with contextlib.suppress(InputError):
                return read_mesh(path, unit=unit)
        raise


def _face(stone: _Stone, values: Mapping[str, Any]) -> tuple[float, _Line]:
    """The side of the face: the default, unless the stone is thinner under the square."""
    size_mm, corners = values["square.size_mm"], values["square.points_mm"]
    usual: float = max(complete({})["macroscale"]["face_mm"], size_mm)
    default = f"{usual:g} mm, the default"
    if is_to_do(corners):
        text = f"{default}: once the square is laid, gst check tells the thickness under it"
        return usual, _Line("Face", text, _DOUBT)
    if not is_closed(stone.mesh):
        text = f"{default}: the mesh has no underside, so no thickness"
        return usual, _Line("Face", text, _DOUBT)
    layout = Layout(size_mm, _RAYS, 0)
    try:
        face = find_use_face(
            stone.mesh, frame_from_points(corners), layout, source=stone.line.text
        )
    except InputError:
        text = f"{default}: the mesh does not show the stone's thickness under the square"
        return usual, _Line("Face", text, _DOUBT)
    side = largest_face(face.thickness)
    text = f"the stone is {side:g} mm thick under the square"
    if side >= usual:
        return usual, _Line("Face", f"{default}: {text}", _OK)
    face_mm = max(size_mm, side)
    state = _OK if size_mm <= side else _DOUBT
    return face_mm, _Line("Face", f"{face_mm:g} mm, as {text}", state)


def _from_scans(
    folder: Path, stone: _Stone, given: Sequence[Path], overview: Path | None, names: str | None
) -> tuple[dict[str, Any], str, list[_Line]]:
    """Values of the config, the patch table, and lines of the listing."""
    root, paths, others = scans_in(given)
    scans, faults = read_scans(
        root, [path for path in paths if overview is None or path != overview.resolve()]
    )
    if not scans:
        raise InputError(root, f"no scan in it can be read: {faults[0]}", "Export them again.")
    pairs = pair_scans(scans, names)
    by_name = {scan.name: scan for scan in scans if scan not in pairs.overviews}
    first = {row.patch: by_name.get(row.t0) for row in pairs.rows}
    units, of_units = _units([*by_name.values()])
    before = [scan for scan in first.values() if scan is not None]
    sizes, is_cut, of_sizes = _sizes(before or [*by_name.values()], units)
    overviews = pairs.overviews if overview is None else _read_overview(overview)
    where = _where(stone, first, overviews, pairs.invert, sizes["scans.size_mm"])
    values = units | sizes | {"inputs.scan_folder": _relative(root, folder)}
    values["scans.mould.invert"] = pairs.invert
    values["scans.mould.flip"] = "x" if pairs.invert is True else None
    values |= where.values
    lines = [of_units, *of_sizes, *_of_pairs(pairs)]
    if is_to_do(values["scans.mould.invert"]) == is_to_do(pairs.invert):  # else the mesh tells
        state = _TO_DO if is_to_do(pairs.invert) else _OK
        lines.append(_Line("Mould", pairs.mould, state))
    lines += where.lines
    lines += [_Line("Not read", fault.removeprefix(f"{root}/"), _DOUBT) for fault in faults]
    left = [*pairs.left, *(path.relative_to(root).as_posix() for path in others)]
    left = [name for name in left if not is_mesh(name)]
    if left:
        text = ", ".join(left[:_SHOWN]) + f", … ({len(left)} files)" * (len(left) > _SHOWN)
        lines.append(_Line("Left out", text))
    return values, _table(pairs, where.places, is_cut=is_cut), lines


def _read_overview(path: Path) -> list[Scan]:
    """The map that is named as the overview."""
    scans, faults = read_scans(path.resolve().parent, [path.resolve()])
    if faults:
        raise InputError(path, f"cannot be read: {faults[0]}", "Correct --overview.")
    return scans


def _units(scans: Sequence[Scan]) -> tuple[dict[str, Any], _Line]:
    """The unit of files that do not state it, and the spacing where nothing tells it."""
    units, count = {scan.unit for scan in scans} - {None}, f"{len(scans)} files"
    if TODO in units or len(units) > 1:
        text = f"{count}; some state neither unit nor spacing: what are these?"
        return {"scans.unit": TODO, "scans.spacing_um": TODO}, _Line("Scans", text, _TO_DO)
    unit = units.pop() if units else None
    sizes = {f"{width:.3g} × {height:.3g}" for height, width in (s.size_mm for s in scans)}
    steps = {f"{1e3 * scan.spacing_mm[1]:.3g}" for scan in scans}
    stated = f"{unit} (only {unit} makes such a field)" if unit else "unit stated"
    text = f"{' and '.join(sorted(sizes))} mm, every {' and '.join(sorted(steps))} µm, {stated}"
    return {"scans.unit": unit}, _Line("Scans", f"{count}, {text}", _OK)


def _sizes(
    scans: Sequence[Scan], units: dict[str, Any]
) -> tuple[dict[str, Any], bool, list[_Line]]:
    """The side of the patches, and whether they are cut from the scans before use."""
    if units["scans.unit"] == TODO:  # of points without a spacing, only the others tell it
        sides = [side for scan in scans if scan.unit != TODO for side in scan.size_mm]
        likely = f"{TODO} {np.mean(sides):.3g}" if sides and _are_same(sides) else TODO
        return {"scans.size_mm": likely}, False, []
    sides = [side for scan in scans for side in scan.size_mm]
    if _are_same(sides):
        return {"scans.size_mm": float(f"{np.mean(sides):.3g}")}, False, []
    size_mm = math.floor(1e3 * min(sides)) / 1e3
    if _are_same([min(scan.size_mm) for scan in scans]):
        text = (
            f"they are not square: the middle {size_mm:g} mm of each one before use are taken"
        )
        return {"scans.size_mm": size_mm}, True, [_Line("", text, _DOUBT)]
    text = f"they are of several sizes: is {size_mm:g} mm the side of all patches?"
    return {"scans.size_mm": f"{TODO} {size_mm:g}"}, True, [_Line("", text, _TO_DO)]


def _are_same(sides: Sequence[float]) -> bool:
    return max(sides) - min(sides) <= _SAME_SIZE * min(sides)


def _of_pairs(pairs: Pairs) -> Iterator[_Line]:
    """Which scans belong together and why, and what is asked."""
    wide = [max(map(len, column)) for column in zip(*pairs.rows, strict=True)]
    for row, evidence in list(zip(pairs.rows, pairs.evidence, strict=True))[:_SHOWN]:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, wide, strict=True) if width]
        state = _TO_DO if TODO in "".join(row) else _DOUBT if ";" in evidence else _OK
        yield _Line("", "  ".join([*cells, evidence]), state)
    if len(pairs.rows) > _SHOWN:
        yield _Line("", f"… and {len(pairs.rows) - _SHOWN} more")
    again = sum(bool(row.repeat) for row in pairs.rows)
    after = sum(row.t1 not in ("", TODO) for row in pairs.rows)
    text = f"{len(pairs.rows)} places, {after} with a scan after use, {again} scanned twice"
    yield _Line("", f"{text}; {pairs.earlier}" if pairs.earlier else text, _OK)
    if any(evidence.endswith(OTHER_SPACING) for evidence in pairs.evidence):
        text = (
            "scans before and after use differ in spacing, so that nothing can be compared: scan "
            "both with the same objective, or resample one in your instrument's software"
        )
        yield _Line("", text, _TO_DO)
    for question in pairs.questions:
        yield _Line("", question, _TO_DO)
    for overview in pairs.overviews:
        height, width = overview.size_mm
        text = f"{overview.name}, {width:.3g} × {height:.3g} mm, is a map of several places"
        yield _Line("Overview", text, _DOUBT)


class _Where(NamedTuple):
    """Where scans lie on the square, by patch, and what follows for the config."""

    places: dict[str, Place]
    values: dict[str, Any]
    lines: list[_Line]


def _where(
    stone: _Stone,
    first: Mapping[str, Scan | None],
    overviews: Sequence[Scan],
    invert: bool | str,
    size_mm: float | str,
) -> _Where:
    """Where scans lie: found on the mesh, or at least their distances, or nothing tells it."""
    scans = {patch: scan for patch, scan in first.items() if scan is not None}
    stages, doubt = _stages([*first.values()], size_mm)
    overviews = [scan for scan in overviews if not is_to_do(scan.unit)]
    can_match = not (isinstance(size_mm, str) or is_to_do(stone.unit) or not scans)
    if overviews and not can_match:
        doubt = (
            f"on {overviews[0].name}, once the units and the side of a patch are known (gst place: "
            "Find their exact places)"
        )
        return _Where({}, {}, [_Line("Where", doubt, _TO_DO)])
    if can_match and (overviews or stages is not None):
        overview = max(overviews, key=lambda scan: min(scan.size_mm), default=None)
        matches = located(
            stone.mesh,
            {patch: scan.coarse for patch, scan in scans.items()},
            overview=None if overview is None else overview.coarse,
            stages=stages,
        )
        by = "the stage's distances" if overview is None else overview.name
        if matches.placed:
            return _by_heights(matches, invert, float(size_mm), by)
        fit = described(matches.on_stone) if matches.on_stone else "too small for the mesh"
        none = ", and no scan is found on it" * bool(matches.frame)
        doubt = f"{by}, on the mesh: {fit}{none}" + f"; {doubt}" * bool(doubt)
    if stages is None:
        text = f"{doubt}: x_mm and y_mm are yours to give"
        return _Where({}, {}, [_Line("Where", text, _TO_DO)])
    return _by_stage([*scans], stages, float(size_mm), is_mould=invert is True)


def _square_mm() -> float:
    side: float = complete({})["square"]["size_mm"]
    return side


def _by_heights(matches: Found, invert: bool | str, size_mm: float, by: str) -> _Where:
    """The square around the scans that were found, how they are laid, and how sure that is."""
    frame, square_mm, places = on_square(matches, side_mm=size_mm, least_mm=_square_mm())
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
    lines = [_Line("Where", f"{by}, on the mesh: {described(matches.on_stone)}", _OK)]
    for patch, match in matches.scans.items():
        lines.append(_Line("", f"{patch}: {described(match)}", _OK if match.found else _TO_DO))
    laid = "mirrored" * first.mirrored, "inverted, as moulds" * inverted
    how = " and ".join(filter(None, laid)) or "as it was scanned"
    lines.append(_Line("", f"the scanned surface fits the mesh {how}", _OK))
    if not is_to_do(invert) and invert != inverted:
        values["scans.mould.invert"] = f"{TODO} {str(inverted).lower()}"
        text = "by their change with use, heights have the other sign: which is right?"
        lines.append(_Line("", text, _TO_DO))
    return _Where(places, values, lines)


def _stages(
    scans: Sequence[Scan | None], size_mm: float | str
) -> tuple[list[tuple[float, float]] | None, str]:
    """The stage's places (x, y), mm; or why they tell nothing."""
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
    if (np.ptp(sizes, axis=0) > _SAME_SIZE * sizes.min()).any():
        return None, "stage coordinates are of maps of different sizes, corners or centres"
    return stages, ""


def _by_stage(
    patches: Sequence[str],
    stages: Sequence[tuple[float, float]],
    size_mm: float,
    *,
    is_mould: bool,
) -> _Where:
    """Distances of patches, in the middle of a square that is still to be laid."""
    at = np.asarray(stages) * ((-1, 1) if is_mould else (1, 1))  # a mould is seen from behind
    middle = (at.min(axis=0) + at.max(axis=0)) / 2
    span = float(np.ptp(at, axis=0).max()) + size_mm
    square_mm = max(_square_mm(), math.ceil(2 * span) / 2)  # in halves of a millimetre
    places = {
        patch: Place(*np.round(place - middle + square_mm / 2, 4)[::-1].tolist())
        for patch, place in zip(patches, at, strict=True)
    }
    mirrored = ", mirrored in x as moulds are" * is_mould
    text = f"by the stage, over {span:.3g} mm{mirrored}; which way its axes run, no file says"
    return _Where(places, {"square.size_mm": square_mm}, [_Line("Where", text, _DOUBT)])


def _table(pairs: Pairs, places: Mapping[str, Place], *, is_cut: bool) -> str:
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
            cells |= {name: round(of, 4) for name, of in place._asdict().items()}
        cells |= {name: cell_of(getattr(row, name)) for name in ("t0", "t1", "repeat")}
        lines.append({column: cells[column] for column in columns})
    return pd.DataFrame(lines, columns=columns).to_csv(
        sep=";", index=False, lineterminator="\n"
    )


def _template(values: dict[str, Any], questions: Sequence[str]) -> str:
    """The shipped config for an own stone, with these values, and the questions above."""
    own = (ROOT / "config/own.yaml").read_text(encoding="utf-8")
    head = own.index("\nresults:")
    body = own[head:].replace(".venv/bin/gst", "gst").replace("data/own/mesh.stl", "MESH")
    lines = textwrap.TextWrapper(98, initial_indent="# - ", subsequent_indent="#   ")
    asked = "".join(f"{lines.fill(question)}\n" for question in questions)
    text = _HEAD + asked + with_values(body, values)
    if "uncertainty.placement_um" in values:  # comes last
        text = f"{text.rstrip()}  # of the places found by heights\n"
    return text


def _of_use(text: str) -> _Line:
    """The load, which no file tells and which has a default."""
    config = complete(parse_yaml(text, "study.yaml"))
    force_N, radius_mm = config["load"]["force_N"], config["counterface"]["radius_mm"]
    text = f"{force_N:g} N against a stone of {radius_mm:g} mm radius are the paper's"
    return _Line("Use", f"{text}: give yours", _DOUBT)


def _what_next(folder: Path, table: str, text: str) -> str:
    """Which files were written, what is left in them, and the next commands."""
    left, cells = len([*left_in(parse_yaml(text, "study.yaml"), {})]), table.count(TODO)
    written = f"  wrote {folder / 'study.yaml'} ({left} {TODO})"
    written += f" and {folder / 'patches.csv'} ({cells} {TODO})" * bool(table)
    place = shlex.join(["gst", "place", str(folder)])
    return (
        f"{written}\n"
        f"  ({_OK}: told by the files; {_DOUBT}: a default or a doubt; {_TO_DO}: {TODO} in them)\n"
        f"\nNext:\n  {place}\n"
        "  (a page to lay the scans on the stone, say how it was used, check and run;\n"
        f"  or write all that is {TODO} into these files, then gst check and gst study)\n"
    )
