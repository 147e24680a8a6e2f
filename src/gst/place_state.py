"""What the page of `gst place` shows and saves: its whole state is the config and the patch table.

Both are read anew for every answer, and only the values that the page asks for are written.
"""

import functools
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
import yaml

from gst.config import complete, read_config, refuse_config, value_problems
from gst.edited import text_of, with_cells, with_values
from gst.patches import EPOCHS, cell_of, find_scans, no_patches
from gst.place_matching import (
    Found,
    corners_of,
    described,
    located,
    on_square,
    seen_in,
    snapped,
)
from gst.scan_folder import OVERVIEW, scans_in
from gst.tables import columns_of
from gst.todo import TODO, is_to_do
from gst.user_tables import read_rows
from gst.viewer import coarsen, stone_data
from gstlib.coupling.matching import Match
from gstlib.errors import ConfigError, GstError, InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.stage import stage_of
from gstlib.preprocess.scans import crop_of, cut_patch, mould_of, prepare_scan
from gstlib.surfaces.footprints import Place, places_of
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import coarser, spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = ["SENT_ANSWERS", "SENT_FILE", "SENT_PLACES", "find_places", "has_stage", "picture_of"]
__all__ += ["save_answers", "save_file", "save_places", "state_of", "stone_of"]

# What the page may write into the config; `inputs.mesh`, for one, is not among it, for the page
# shows files.
_ANSWERS = (
    "counterface.radius_mm",
    "inputs.mesh_unit",
    "load.at_mm",
    "load.force_N",
    "material.contact_modulus_MPa",
    "material.poisson_1",
    "material.poisson_2",
    "material.young_1_MPa",
    "material.young_2_MPa",
    "scans.mould.flip",
    "scans.mould.invert",
    "scans.size_mm",
    "scans.spacing_um",
    "scans.unit",
    "uncertainty.force_fraction",
    "uncertainty.placement_um",
    "uncertainty.radius_fraction",
)
# A table of places that the study proposes is a patch table, too.
_RENAMED = {"place": "patch"}
# Its name where a study begins without one, as `gst new` has it.
_TABLE = "patches.csv"
# Points along the side of a picture, and the light on it, as `viewer.js` has it at first.
_PICTURE_POINTS = 160
_MATCHED_POINTS = 256  # along the side of an overview
_AZIMUTH, _ALTITUDE = 315, 45
# Share of unmeasured points up to which a scan can be shown.
_MOSTLY_HOLES = 0.9
# Decimals of a place (mm) and of a turn (degrees).
_DECIMALS = 3
# What the page sends, as JSON.
SENT_ANSWERS: dict[str, Any] = {
    "type": "object",
    "propertyNames": {"enum": [*_ANSWERS]},
    "additionalProperties": {
        "type": ["number", "string", "boolean", "array", "null"],
        "items": {"type": "number"},
    },
}
SENT_FILE: dict[str, Any] = {
    "type": "object",
    "required": ["patch", "column", "name"],
    "properties": {key: {"type": "string"} for key in ("patch", "column", "name")},
}
_LENGTH = {"type": ["number", "null"], "minimum": -1000, "maximum": 1000}
_PLACE = {
    "patch": {"type": "string", "pattern": "^[A-Za-z0-9][A-Za-z0-9-]*$"},
    "x_mm": _LENGTH,
    "y_mm": _LENGTH,
    "rotation_deg": {"type": "number", "minimum": -180, "maximum": 180},
    "wear_grade": {"type": ["integer", "null"], "minimum": 0, "maximum": 9},
}
_SQUARE = {"size_mm": {"type": "number"}, "points_mm": {"type": ["array", "null"]}}
SENT_PLACES: dict[str, Any] = {
    "type": "object",
    "required": ["square", "patches"],
    "properties": {
        "square": {"type": "object", "required": [*_SQUARE], "properties": _SQUARE},
        "patches": {
            "type": "array",
            "items": {"type": "object", "required": [*_PLACE], "properties": _PLACE},
        },
    },
}


def state_of(path: Path) -> dict[str, Any]:
    """All that the page shows, ready for JSON; a value that is still to be given is null.

    Raises a `ConfigError` if the config or its table cannot be read.
    """
    config = read_config(path)
    rows, has_scans = _rows_of(config)
    columns = ["patch", "x_mm", "y_mm", "rotation_deg", "wear_grade"]
    asked = [
        {"patch": row.patch, "column": column, "likely": likely.removeprefix(TODO).strip()}
        for row in rows.itertuples()
        for column in EPOCHS
        if is_to_do(likely := getattr(row, column))
    ]
    return {
        "title": config["title"],
        "mesh": config["inputs"] and Path(config["inputs"]["mesh"]).name,
        "square": {
            "points_mm": _known(config["square"]["points_mm"]),
            "size_mm": _known(config["square"]["size_mm"]),
        },
        "patch_size_mm": _known(config["scans"]["size_mm"]),
        "has_scans": has_scans,
        "patches": rows[columns].astype(object).where(rows.notna(), None).to_dict("records"),
        "asked": asked,
        "files": _files_of(config) if asked else [],
        "own_tool": "mesh" in (config["counterface"] or {}),
        "answers": {key: _value(config, key) for key in _ANSWERS},
    }


def _files_of(config: Mapping) -> list[str]:
    """The names of all scans in their folder."""
    root, paths, _ = scans_in([Path(config["inputs"]["scan_folder"])])
    return [path.relative_to(root).as_posix() for path in paths]


def _known(value: Any) -> Any:
    return None if is_to_do(value) else value


def _value(config: Mapping, key: str) -> Any:
    """The value at a key; None where a section is."""
    value: Any = config
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def _rows_of(config: Mapping) -> tuple[pd.DataFrame, bool]:
    """The rows of the patch table, whatever is still wrong with them, and if they have scans."""
    if config["patches"] is None:
        return no_patches(), False
    ignored = columns_of("places")
    table = read_rows(config["patches"], "patches", renamed=_RENAMED, ignored=ignored)
    has_scans = not {"t0", "t1"}.isdisjoint(table.columns) or "wear_grade" not in table.columns
    rows = table.rows.reset_index(drop=True)
    if config["inputs"] is not None and has_scans:
        # what no file fits, the check says
        list(find_scans(rows, table.columns, config["inputs"]["scan_folder"]))
    return rows, has_scans


def save_answers(path: Path, values: Mapping[str, Any]) -> None:
    """Write values into the config, each by its key; they fit `SENT_ANSWERS`.

    Raises a `ConfigError` if a value cannot be meant.
    """
    given = dict(values)
    of_pressure = _value(read_config(path), "load.pressure_MPa")
    if "load.force_N" in given and of_pressure is not None:
        given["load.pressure_MPa"] = None  # exactly one of them
    write_whole(path, _checked(path, given).encode())


def save_file(path: Path, patch: str, column: str, name: str) -> None:
    """Write which scan a patch has at an epoch, or "" for none; they fit `SENT_FILE`.

    Raises a `ConfigError` if this is not asked for, or there is no such scan in the folder.
    """
    config = read_config(path)
    state = state_of(path)
    is_asked = (patch, column) in [(row["patch"], row["column"]) for row in state["asked"]]
    if not is_asked or name not in ["", *state["files"]]:
        problem = f"{column} of patch {patch} is not asked for, or there is no scan {name}"
        raise ConfigError(config["patches"], problem, "Load the page again.")
    table = Path(config["patches"])
    cells = {column: cell_of(name)}
    text = with_cells(text_of(table), lambda row: cells if row["patch"] == patch else {})
    write_whole(table, text.encode())


def save_places(path: Path, square: Mapping[str, Any], rows: Sequence[Mapping]) -> None:
    """Write the square and the patches' places, or the places of a tool without scans.

    They fit `SENT_PLACES`; null is still to be given. Raises a `ConfigError` if a value cannot be
    meant, or the table has become another.
    """
    config = read_config(path)
    former, has_scans = _rows_of(config)
    names = [row["patch"] for row in rows]
    is_known = sorted(names) == sorted(former.patch)
    if not is_known and (has_scans or len({*names}) < len(names)):
        problem = f"the page has the patches {names}, the table {[*former.patch]}"
        raise ConfigError(config["patches"], problem, "Load the page again.")
    is_turned = bool(former.rotation_deg.any() or any(row["rotation_deg"] for row in rows))
    table = [_cells(row, turn=is_turned, grade=not has_scans) for row in rows]
    points = square["points_mm"]
    values: dict[str, Any] = {"square.size_mm": square["size_mm"]}
    values["square.points_mm"] = TODO if points is None else points
    if not has_scans:
        values["patches"] = str(config["patches"] or _TABLE) if rows else None
    changed = {key: value for key, value in values.items() if value != _value(config, key)}
    text = _checked(path, changed)
    _write_table(config["patches"], table)
    write_whole(path, text.encode())


def _cells(row: Mapping[str, Any], *, turn: bool, grade: bool) -> dict[str, str]:
    """A row as text; null is still to be given, a grade unknown."""
    numbers = ["x_mm", "y_mm", *["rotation_deg"] * turn, *["wear_grade"] * grade]
    cells = {"patch": row["patch"]}
    for column in numbers:
        empty = "" if column == "wear_grade" else TODO
        value = row[column]
        cells[column] = empty if value is None else f"{round(value, _DECIMALS) + 0:.10g}"
    return cells


def _write_table(former: str | None, rows: Sequence[Mapping[str, str]]) -> None:
    """Write the table with these rows; without any, it goes."""
    file = Path(former or _TABLE)
    if former is None and rows and file.exists():
        raise InputError(file, "exists, and the config does not name it", "Rename it.")
    if former is None and rows:
        lines = [";".join(rows[0]), *(";".join(row.values()) for row in rows)]
        write_whole(file, "".join(f"{line}\n" for line in lines).encode())
    elif rows:
        left = {row["patch"]: row for row in rows}
        # each row takes its own out, and those that the table lacks come at its end
        text = with_cells(
            text_of(file), lambda row: left.pop(row["patch"], None), left.values(), _RENAMED
        )
        write_whole(file, text.encode())
    elif former is not None:
        file.unlink(missing_ok=True)


def _checked(path: Path, values: Mapping[str, Any]) -> str:
    """The config's text with these values; a `ConfigError` if one of them cannot be meant."""
    text = with_values(path.read_text(encoding="utf-8"), values)
    config = complete(yaml.safe_load(text))
    asked = [key for key, value in values.items() if not is_to_do(value)]
    refuse_config(value_problems(config, asked), str(path))
    return text


def stone_of(path: Path) -> dict[str, Any]:
    """The stone of a config, as `gst.viewer.stone_data` has it."""
    return stone_data(coarsen(_mesh_of(path)))


def _mesh_of(path: Path) -> "trimesh.Trimesh":
    inputs = read_config(path)["inputs"]
    if inputs is None:
        raise ConfigError(path, "names no mesh", "Give inputs.mesh, or begin with `gst new`.")
    if is_to_do(inputs["mesh_unit"]):
        raise ConfigError(path, "does not say the unit of the mesh", "Give it on this page.")
    mesh = Path(inputs["mesh"])
    return _read_once(mesh, inputs["mesh_unit"], _version(mesh))


@functools.lru_cache(maxsize=1)
def _read_once(mesh: Path, unit: str | None, _version: object) -> "trimesh.Trimesh":
    return read_mesh(mesh, unit=unit)


def _version(path: Path) -> object:
    """What changes with a file; None while there is none."""
    return (path.stat().st_mtime_ns, path.stat().st_size) if path.is_file() else None


def find_places(path: Path) -> dict[str, Any]:
    """Where the scans lie on the stone by their heights, to be shown; nothing is written.

    On an overview map in the scans' folder, or tied together by the stage; otherwise near the
    places that the table has. The result has the ``square`` and the ``places`` that were found
    (``patch, x_mm, y_mm, rotation_deg``); what was ``said`` of each patch, and of ``all``; and the
    ``answers`` that follow from how the scans are laid.
    """
    config = read_config(path)
    rows, _ = _rows_of(config)
    scans = dict(zip(rows.patch, _scans_of(path, [*rows.index]), strict=True))
    heights = {patch: scan.heights for patch, scan in scans.items()}
    mesh, square = _mesh_of(path), config["square"]
    size_mm, laid = square["size_mm"], _known(square["points_mm"])
    overview = _overview_of(config, [*rows.t0, *rows.t1, *rows["repeat"]])
    found = located(mesh, heights, overview=overview, stages=_stages([*scans.values()]))
    said = {patch: described(match) for patch, match in found.scans.items()}
    if found.placed:
        matches = found.scans
        frame, size_mm, places = on_square(
            found, side_mm=config["scans"]["size_mm"], least_mm=size_mm
        )
        if laid is not None:
            places = seen_in(frame_from_points(laid), found)
            size_mm = square["size_mm"]
        else:
            laid = corners_of(frame, size_mm)
    else:
        hand = rows.dropna(subset=["x_mm", "y_mm"])
        if laid is None or hand.empty:
            raise ConfigError(
                path, _nothing_found(found), "Lay the square, and the scans on it."
            )
        frame = frame_from_points(laid)
        try:
            matches = snapped(mesh, frame, size_mm, heights, places_of(hand))
        except ValueError as error:
            why = f"the mesh is too coarse: {error}"
            return {"square": square, "places": [], "said": {}, "all": why, "answers": {}}
        places = {patch: match.place for patch, match in matches.items() if match.found}
        said = {patch: described(match) for patch, match in matches.items()}
    return {
        "square": {"points_mm": laid, "size_mm": size_mm},
        "places": [{"patch": patch} | _shown(place) for patch, place in places.items()],
        "said": said,
        "all": f"{len(places)} of {len(rows)} found",
        "answers": _of_matches(config, [matches[patch] for patch in places]),
    }


def _shown(place: Place) -> dict[str, float]:
    return {name: round(value, _DECIMALS) for name, value in place._asdict().items()}


def _nothing_found(found: Found) -> str:
    """Why no scan is found without places by hand."""
    if found.on_stone is None:
        return "has neither an overview map nor the stage's places, nor places by hand"
    return f"has scans that are not found on the stone: {described(found.on_stone)}"


def _of_matches(config: Mapping, matches: Sequence[Match]) -> dict[str, Any]:
    """How moulds are undone and how sure places are, by scans that were matched undone."""
    if not matches:
        return {}
    mould, match = config["scans"]["mould"], matches[0]
    error_um = math.ceil(1e3 * math.sqrt(np.mean([each.error_mm**2 for each in matches])))
    values: dict[str, Any] = {"uncertainty.placement_um": error_um}
    if match.inverted:
        values["scans.mould.invert"] = not mould["invert"]
    if match.mirrored:
        values["scans.mould.flip"] = "x" if mould["flip"] is None else None
    return values


def _overview_of(config: Mapping, used: Sequence[str]) -> xr.DataArray | None:
    """The largest map in the scans' folder that is no patch's and holds several."""
    root, paths, _ = scans_in([Path(config["inputs"]["scan_folder"])])
    scans, best = config["scans"], None
    for path in paths:
        if path.relative_to(root).as_posix() in used:
            continue
        try:
            scan = read_scan(path, unit=scans["unit"], spacing_um=scans["spacing_um"])
        except GstError:
            continue
        side = min(np.multiply(scan.shape, spacing_of(scan)))
        if side > OVERVIEW * scans["size_mm"] and (best is None or side > best[0]):
            best = side, scan
    if best is None:
        return None
    mould = bool(scans["mould"]["invert"]), scans["mould"]["flip"]
    return _undone(best[1], *mould)


def _undone(scan: xr.DataArray, invert: bool, flip: str | None) -> xr.DataArray:
    """Heights of the stone from those of a mould, on fewer points."""
    scan = coarser(scan, max(1, min(scan.shape) // _MATCHED_POINTS))
    return prepare_scan(
        scan, mould_invert=invert, mould_flip=flip, maximum_unmeasured=_MOSTLY_HOLES
    ).height


class _Scan(NamedTuple):
    """What the page needs of a scan."""

    picture: bytes  # PNG, y up
    stage_mm: tuple[float, float] | None
    heights: xr.DataArray  # prepared, on the picture's points


def picture_of(path: Path, number: int) -> bytes:
    """The scan at T0 of a row of the patch table, as it lies on the square, shaded (PNG)."""
    return _scans_of(path, [number])[0].picture


def has_stage(path: Path) -> bool:
    """Whether every scan has a place from the stage, each another."""
    rows, has_scans = _rows_of(read_config(path))
    return has_scans and _stages(_scans_of(path, [*rows.index])) is not None


def _stages(scans: Sequence[_Scan]) -> list[tuple[float, float]] | None:
    """The stage's places; None unless it has one for each of several scans, each another."""
    found = [scan.stage_mm for scan in scans if scan.stage_mm is not None]
    return found if 1 < len({*found}) == len(scans) else None


def _scans_of(path: Path, numbers: Sequence[int]) -> list[_Scan]:
    config = read_config(path)
    rows, _ = _rows_of(config)
    scans, found = config["scans"], []
    given = (config["inputs"] or {}).get("scan_folder")
    if given is None:
        raise ConfigError(path, "names no scans", "Give inputs.scan_folder.")
    folder = Path(given).resolve()
    for number in numbers:
        if number not in rows.index or not rows.t0[number]:
            raise InputError(path, f"there is no scan {number}", "Load the page again.")
        file = (folder / rows.t0[number]).resolve()
        if not file.is_relative_to(folder):
            raise InputError(file, f"lies outside {folder}", "Correct the patch table.")
        row = rows.loc[number]
        mould = mould_of(scans["mould"], row.flip)
        settings = (scans["size_mm"], scans["unit"], scans["spacing_um"])
        if left := [value for value in (*settings, mould["invert"]) if is_to_do(value)]:
            raise ConfigError(path, f"has {left} in scans", "Give it first.")
        mirrored = bool(mould["invert"]), mould["flip"]
        found.append(_scan(file, settings, mirrored, crop_of(row), _version(file)))
    return found


@functools.lru_cache(maxsize=1000)
def _scan(
    file: Path,
    settings: tuple[float, str | None, float | None],
    mould: tuple[bool, str | None],
    crop: tuple[float, float] | None,
    _version: object,
) -> _Scan:
    from matplotlib.colors import LightSource
    from matplotlib.image import imsave

    size_mm, unit, spacing_um = settings
    invert, flip = mould
    raw = read_scan(file, unit=unit, spacing_um=spacing_um)
    piece = cut_patch(raw, crop=crop, size_mm=size_mm, mould_flip=flip)
    piece = coarser(piece, max(1, math.ceil(min(piece.shape) / _PICTURE_POINTS)))
    prepared = prepare_scan(
        piece, mould_invert=invert, mould_flip=flip, maximum_unmeasured=_MOSTLY_HOLES
    )
    step_y, step_x = spacing_of(piece)
    light = LightSource(azdeg=_AZIMUTH, altdeg=_ALTITUDE)
    # a picture begins with its top row
    shade = light.hillshade(np.flipud(prepared.height.values), dx=step_x, dy=step_y)
    content = io.BytesIO()
    imsave(content, shade, cmap="gray", vmin=0, vmax=1, format="png")
    return _Scan(content.getvalue(), stage_of(raw), prepared.height)
