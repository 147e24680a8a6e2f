"""A study from a mesh and a folder of scans: `gst new FOLDER --mesh M --scans S`.

It writes ``study.yaml`` and ``patches.csv``, and says what was inferred and from what. Where the
scans lie is found with an overview map or the stage's places. What the files do not tell is marked
`TODO`, and `gst check` refuses it.
"""

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
from gstlib.surfaces.frames import Frame, frame_from_points

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


class _Said(NamedTuple):
    """A line of what was found."""

    topic: str
    text: str
    state: str = ""


class _Stone(NamedTuple):
    """What the mesh says."""

    mesh: "trimesh.Trimesh"
    unit: str  # or `TODO`
    said: _Said


def new_study(
    folder: Path, mesh: Path, scans: Sequence[Path], overview: Path | None = None
) -> str:
    """Write a study into a folder; what was inferred, from what, and what is to be done.

    An `overview` is a map of the face that holds the scanned places; among the scans, the one that
    is much larger than the others is taken for it. Raises an `InputError` if a file cannot be read,
    or the folder has a study.
    """
    config_path, table_path = folder / "study.yaml", folder / "patches.csv"
    if there := [path for path in (config_path, table_path) if path.exists()]:
        raise InputError(there[0], "exists already", "Name another folder, or remove it.")
    stone, table = _read_stone(mesh), ""
    said = [stone.said]
    values: dict[str, Any] = {
        "results": "results",
        "title": folder.resolve().name,
        "inputs.mesh": _relative(mesh, folder),
        "inputs.mesh_unit": stone.unit,
        "square.points_mm": TODO,
    }
    if scans:
        of_scans, table, more = _from_scans(folder, stone, scans, overview)
        said += of_scans
        values |= {"patches": table_path.name} | more
    else:
        values |= {"patches": None, "inputs.scan_folder": None, "gesture": _GESTURE}
        text = "none: the study proposes where to scan, for a load point that scatters by 1 mm"
        said.append(_Said("Scans", text, _DOUBT))
    points_mm = values["square.points_mm"]
    corners = None if is_to_do(points_mm) else points_mm
    face_mm, of_face = _face(stone, values.get("square.size_mm", 5.0), corners)
    values = {"macroscale.face_mm": face_mm} | values
    text = _template(values, [each for each in said if each.state == _TO_DO])
    said += [of_face, _of_use(text)]
    if table:
        write_whole(table_path, table.encode())
    write_whole(config_path, text.encode())
    return _listing(said) + _what_next(folder, table, text)


def _listing(said: Sequence[_Said]) -> str:
    """What was found, a line each, with its state at the end."""
    wide = min(_WIDEST, max(len(each.text) for each in said))
    lines = [f"  {each.topic:<{_TOPIC}}{each.text:<{wide}}  {each.state}" for each in said]
    return "".join(f"{line.rstrip()}\n" for line in lines)


def _relative(path: Path, folder: Path) -> str:
    """A path from the folder of the study, absolute where there is no way between them."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.resolve().as_posix()


def _read_stone(path: Path) -> _Stone:
    """The mesh in mm, and in which unit it is: the file's own, or the one that makes a stone."""
    try:
        mesh = read_mesh(path)
    except InputError:  # a unit that is not stated, and not mm
        for unit in UNITS:
            try:
                mesh = read_mesh(path, unit=unit)
                break
            except InputError:
                continue
        else:
            raise
    file_unit = mesh.metadata["file_unit"]
    sides = mesh.extents / UNITS[file_unit]
    shown = " × ".join(f"{side:.4g}" for side in sides)
    steps = f", coordinates in {steps_of(mesh)}"
    if mesh.metadata["states_unit"]:
        text = f"{shown} {file_unit}, as the file states{steps}"
        return _Stone(mesh, file_unit, _Said("Mesh", text, _OK))
    fitting = units_of_size(float(max(sides)))
    if len(fitting) == 1:
        (unit,) = fitting
        if unit != file_unit:
            mesh = read_mesh(path, unit=unit)
        steps = f", coordinates in {steps_of(mesh)}"
        text = f"{shown} → {unit} (only {unit} makes a hand-sized stone){steps}"
        return _Stone(mesh, unit, _Said("Mesh", text, _OK))
    sizes = " or ".join(f"{max(sides) * UNITS[unit]:.3g} mm ({unit})" for unit in fitting)
    text = f"{shown}, its unit not stated: is the stone {sizes} long?"
    return _Stone(mesh, TODO, _Said("Mesh", text, _TO_DO))


def _face(
    stone: _Stone, size_mm: float, corners: Sequence[Sequence[float]] | None
) -> tuple[float, _Said]:
    """The side of the face: the default, unless the stone is thinner under the square.

    Before the square is known, by its `corners`, the stone's middle stands for it.
    """
    usual: float = complete({})["macroscale"]["face_mm"]
    usual = max(usual, size_mm)
    if stone.unit == TODO or not is_closed(stone.mesh):
        why = "its unit is not known" if stone.unit == TODO else "the mesh has no underside"
        return usual, _Said(
            "Face", f"{usual:g} mm, the default: {why}, so no thickness", _DOUBT
        )
    frame = _broad_side(stone.mesh, size_mm) if corners is None else frame_from_points(corners)
    where = "through its middle" if corners is None else "under the square"
    layout = Layout(size_mm, _RAYS, 0)
    try:
        found = find_use_face(stone.mesh, frame, layout, source=stone.said.text)
    except InputError:
        text = f"{usual:g} mm, the default: the mesh does not show its thickness {where}"
        return usual, _Said("Face", text, _DOUBT)
    side = largest_face(found.thickness)
    through = f"the stone is {side:g} mm thick {where}"
    through += "; gst check tells it of the square" * (corners is None)
    state = _DOUBT if corners is None or size_mm > side else _OK
    if side >= usual:
        return usual, _Said("Face", f"{usual:g} mm, the default: {through}", state)
    face_mm = max(size_mm, side)
    return face_mm, _Said("Face", f"{face_mm:g} mm, as {through}", state)


def _broad_side(mesh: "trimesh.Trimesh", size_mm: float) -> Frame:
    """The frame of a square in the middle of a stone's broad side."""
    middle = mesh.triangles_center.mean(axis=0)
    points = np.asarray(mesh.vertices) - middle
    normal, _, x_axis = np.linalg.eigh(np.cov(points, rowvar=False))[1].T
    centre = middle + (points @ normal).max() * normal
    corner = centre - size_mm / 2 * (x_axis + np.cross(normal, x_axis))
    return Frame(corner, x_axis, normal)


def _from_scans(
    folder: Path, stone: _Stone, given: Sequence[Path], overview: Path | None
) -> tuple[list[_Said], str, dict[str, Any]]:
    """What the scans say, the patch table, and values of the config."""
    root, paths, others = scans_in(given)
    is_overview = overview.resolve() if overview else None
    scans, faults = read_scans(root, [path for path in paths if path != is_overview])
    if not scans:
        raise InputError(root, f"no scan in it can be read: {faults[0]}", "Export them again.")
    pairs = pair_scans(scans)
    by_name = {scan.name: scan for scan in scans if scan not in pairs.overviews}
    first = {row.patch: by_name.get(row.t0) for row in pairs.rows}
    there = [scan for scan in first.values() if scan is not None]
    units = _units([*by_name.values()])
    sizes, is_cut, of_sizes = _sizes(there or [*by_name.values()], units)
    units |= sizes
    said = [_of_files([*by_name.values()], units), *of_sizes, *_of_pairs(pairs)]
    overviews = pairs.overviews if overview is None else _read_overview(overview)
    where = _where(stone, first, overviews, pairs.invert, sizes["scans.size_mm"])
    mould: dict[str, Any] = {"scans.mould.invert": pairs.invert, "scans.mould.flip": None}
    if pairs.invert is True:
        mould["scans.mould.flip"] = "x"
    values = units | {"inputs.scan_folder": _relative(root, folder)} | mould | where.values
    if is_to_do(values["scans.mould.invert"]) == is_to_do(
        pairs.invert
    ):  # else the mesh tells it
        state = _TO_DO if is_to_do(pairs.invert) else _OK
        said.append(_Said("Mould", pairs.mould, state))
    said += where.said
    said += [_Said("Not read", fault.removeprefix(f"{root}/"), _DOUBT) for fault in faults]
    left = [*pairs.left, *(path.relative_to(root).as_posix() for path in others)]
    left = [name for name in left if not is_mesh(name)]
    if left:
        named = ", ".join(left[:_SHOWN]) + f", … ({len(left)} files)" * (len(left) > _SHOWN)
        said.append(_Said("Left out", named))
    return said, _table(pairs, where.places, is_cut=is_cut), values


def _read_overview(path: Path) -> list[Scan]:
    """The map that is named as the overview."""
    scans, faults = read_scans(path.resolve().parent, [path.resolve()])
    if faults:
        raise InputError(path, f"cannot be read: {faults[0]}", "Correct --overview.")
    return scans


def _units(scans: Sequence[Scan]) -> dict[str, Any]:
    """The unit of files that do not state it, and the spacing where nothing tells it."""
    given = {scan.unit for scan in scans} - {None}
    if TODO in given or len(given) > 1:
        return {"scans.unit": TODO, "scans.spacing_um": TODO}
    return {"scans.unit": given.pop() if given else None}


def _of_files(scans: Sequence[Scan], units: dict[str, Any]) -> _Said:
    """How many scans there are, how large, and in which unit."""
    unit, count = units["scans.unit"], f"{len(scans)} files"
    if unit == TODO:
        text = f"{count}; some state neither unit nor spacing: what are these?"
        return _Said("Scans", text, _TO_DO)
    sizes = {f"{width:.3g} × {height:.3g}" for height, width in (s.size_mm for s in scans)}
    steps = {f"{1e3 * scan.spacing_mm[1]:.3g}" for scan in scans}
    stated = "unit stated" if unit is None else f"{unit} (only {unit} makes such a field)"
    text = f"{' and '.join(sorted(sizes))} mm, every {' and '.join(sorted(steps))} µm, {stated}"
    return _Said("Scans", f"{count}, {text}", _OK)


def _sizes(
    scans: Sequence[Scan], units: dict[str, Any]
) -> tuple[dict[str, Any], bool, list[_Said]]:
    """The side of the patches, and whether they are cut from the scans before use."""
    if units["scans.unit"] == TODO:  # of points without a spacing, only the others tell it
        known = [side for scan in scans if scan.unit != TODO for side in scan.size_mm]
        is_likely = known and max(known) - min(known) <= _SAME_SIZE * min(known)
        likely = f"{TODO} {np.mean(known):.3g}" if is_likely else TODO
        return {"scans.size_mm": likely}, False, []
    sides = [side for scan in scans for side in scan.size_mm]
    shorter = [min(scan.size_mm) for scan in scans]
    if max(sides) - min(sides) <= _SAME_SIZE * min(sides):
        return {"scans.size_mm": float(f"{np.mean(sides):.3g}")}, False, []
    size_mm = math.floor(1e3 * min(sides)) / 1e3
    if max(shorter) - min(shorter) <= _SAME_SIZE * min(shorter):
        text = (
            f"they are not square: the middle {size_mm:g} mm of each one before use are taken"
        )
        return {"scans.size_mm": size_mm}, True, [_Said("", text, _DOUBT)]
    text = f"they are of several sizes: is {size_mm:g} mm the side of all patches?"
    return {"scans.size_mm": f"{TODO} {size_mm:g}"}, True, [_Said("", text, _TO_DO)]


def _of_pairs(pairs: Pairs) -> Iterator[_Said]:
    """Which scans belong together and why, and what is asked."""
    shown = [(row.patch, row.t0, row.t1, row.repeat) for row in pairs.rows]
    wide = [max(map(len, column)) for column in zip(*shown, strict=True)]
    for row, evidence in list(zip(shown, pairs.evidence, strict=True))[:_SHOWN]:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, wide, strict=True) if width]
        state = _TO_DO if TODO in "".join(row) else _DOUBT if ";" in evidence else _OK
        yield _Said("", "  ".join([*cells, evidence]), state)
    if len(shown) > _SHOWN:
        yield _Said("", f"… and {len(shown) - _SHOWN} more")
    twice = sum(bool(row.repeat) for row in pairs.rows)
    after = sum(row.t1 not in ("", TODO) for row in pairs.rows)
    text = f"{len(shown)} places, {after} with a scan after use, {twice} scanned twice"
    yield _Said("", f"{text}; {pairs.earlier}" if pairs.earlier else text, _OK)
    if any(evidence.endswith(OTHER_SPACING) for evidence in pairs.evidence):
        text = (
            "scans before and after use differ in spacing, so that nothing can be compared: scan "
            "both with the same objective, or resample one in your instrument's software"
        )
        yield _Said("", text, _TO_DO)
    for question in pairs.questions:
        yield _Said("", question, _TO_DO)
    for overview in pairs.overviews:
        height, width = overview.size_mm
        text = f"{overview.name}, {width:.3g} × {height:.3g} mm, is a map of several places"
        yield _Said("Overview", text, _DOUBT)


class _Where(NamedTuple):
    """Where scans lie on the square, by patch, and what follows for the config."""

    places: dict[str, Place]
    values: dict[str, Any]
    said: list[_Said]


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
        return _Where({}, {"square.size_mm": _square_mm()}, [_Said("Where", doubt, _TO_DO)])
    if can_match and (overviews or stages is not None):
        overview = max(overviews, key=lambda scan: min(scan.size_mm), default=None)
        found = located(
            stone.mesh,
            {patch: scan.coarse for patch, scan in scans.items()},
            overview=None if overview is None else overview.coarse,
            stages=stages,
        )
        by = "the stage's distances" if overview is None else overview.name
        if found.placed:
            return _found(found, invert, float(size_mm), by)
        told = described(found.on_stone) if found.on_stone else "too small for the mesh"
        none = ", and no scan is found on it" * bool(found.frame)
        doubt = f"{by}, on the mesh: {told}{none}" + f"; {doubt}" * bool(doubt)
    if stages is None:
        text = f"{doubt}: x_mm and y_mm are yours to give"
        return _Where({}, {"square.size_mm": _square_mm()}, [_Said("Where", text, _TO_DO)])
    return _by_stage([*scans], stages, float(size_mm), is_mould=invert is True)


def _square_mm() -> float:
    side: float = complete({})["square"]["size_mm"]
    return side


def _found(found: Found, invert: bool | str, size_mm: float, by: str) -> _Where:
    """The square around the scans that were found, how they are laid, and how sure that is."""
    frame, square_mm, places = on_square(found, side_mm=size_mm, least_mm=_square_mm())
    any_of_them = next(iter(found.placed.values()))
    inverted, error_um = any_of_them.inverted, math.ceil(found.error_um)
    values = {
        "square.size_mm": square_mm,
        "square.points_mm": corners_of(frame, square_mm),
        "scans.mould.invert": inverted,
        "scans.mould.flip": "x" if any_of_them.mirrored else None,
        "uncertainty.placement_um": error_um,
    }
    assert found.on_stone is not None
    said = [_Said("Where", f"{by}, on the mesh: {described(found.on_stone)}", _OK)]
    for patch, match in found.scans.items():
        said.append(_Said("", f"{patch}: {described(match)}", _OK if match.found else _TO_DO))
    laid = "mirrored" * any_of_them.mirrored, "inverted, as moulds" * inverted
    how = " and ".join(filter(None, laid)) or "as it was scanned"
    said.append(_Said("", f"what was scanned fits the mesh {how}", _OK))
    if not is_to_do(invert) and invert != inverted:
        values["scans.mould.invert"] = f"{TODO} {str(inverted).lower()}"
        text = "by their change with use, heights have the other sign: which is right?"
        said.append(_Said("", text, _TO_DO))
    return _Where(places, values, said)


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
    on_it = np.round(at - middle + square_mm / 2, 4)
    places = {
        patch: Place(float(y), float(x)) for patch, (x, y) in zip(patches, on_it, strict=True)
    }
    mirrored = ", mirrored in x as moulds are" * is_mould
    text = f"by the stage, over {span:.3g} mm{mirrored}; which way its axes run, no file says"
    return _Where(places, {"square.size_mm": square_mm}, [_Said("Where", text, _DOUBT)])


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


def _template(values: dict[str, Any], asked: Sequence[_Said]) -> str:
    """The shipped config for an own stone, with these values, and what is asked above."""
    own = (ROOT / "config/own.yaml").read_text(encoding="utf-8")
    head = own.index("\nresults:")
    body = own[head:].replace(".venv/bin/gst", "gst").replace("data/own/mesh.stl", "MESH")
    lines = textwrap.TextWrapper(98, initial_indent="# - ", subsequent_indent="#   ")
    left = "".join(f"{lines.fill(each.text)}\n" for each in asked)
    text = _HEAD + left + with_values(body, values)
    if "uncertainty.placement_um" in values:  # comes last
        text = f"{text.rstrip()}  # of the places found by heights\n"
    return text


def _of_use(text: str) -> _Said:
    """What no file tells and has a default."""
    config = complete(parse_yaml(text, "study.yaml"))
    force_N, radius_mm = config["load"]["force_N"], config["counterface"]["radius_mm"]
    said = (
        f"{force_N:g} N against a stone of {radius_mm:g} mm radius are the paper's: give yours"
    )
    return _Said("Use", said, _DOUBT)


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
