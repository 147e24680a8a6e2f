"""State of the page of `gst place`: it is in the config and the patch table alone.

Both are read anew for every answer, and only the values that the page asks for are written. A copy
of the table is kept beside it before rows or filled cells are removed.
"""

import contextlib
import functools
import io
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from gst.check.fixing import keep_copy
from gst.config.edited import Cells, save_text, text_of, with_cells, with_values
from gst.config.patches import EPOCHS, cell_of, find_scans, no_patches
from gst.config.reading import complete, read_unfinished, refuse_config, value_problems
from gst.config.strict_yaml import parse_yaml
from gst.config.todo import TODO, is_to_do
from gst.config.user_tables import read_rows
from gst.page.viewer import coarsen, packed, stone_data
from gst.setup.scan_folder import scans_in
from gstlib.errors import ConfigError, GstError, InputError
from gstlib.io.files import sha256, write_whole
from gstlib.io.meshes import UNITS, read_mesh
from gstlib.use.evidence import FEWEST_PATCHES

if TYPE_CHECKING:
    import trimesh

# Values by the key of a config, or by the column of a row.
_Values = Mapping[str, Any]

# Keys that the page may write. `inputs.mesh`, for one, is missing, because the page shows files.
_ANSWERS = (
    "accept",
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
    "uncertainty.force_log_sd",
    "uncertainty.placement_um",
    "uncertainty.radius_log_sd",
)
# Name of the patch table where a study begins without one, as `gst new` has it.
_TABLE = "patches.csv"
# Decimals of a place (mm) and of a turn (degrees).
DECIMALS = 3
_PLACE = ["patch", "x_mm", "y_mm", "rotation_deg", "wear_grade"]


def digest_of(path: Path) -> str:
    """The SHA-256 of a config and of its patch table as they are on the disk, one behind the other.

    A file that does not exist, or cannot be found for a damaged config, is left out.
    """
    return ":".join(sha256(file) for file in _files_of(path) if file.is_file())


def check_files(path: Path) -> None:
    """Raise an `InputError` if the config or its table is a link, or lies outside the study."""
    for file in _files_of(path):
        if file.is_symlink() or not file.resolve().is_relative_to(Path.cwd()):
            problem = (
                "is a link or outside the folder of the study, so it is not changed"
            )
            raise InputError(file, problem, "Put the file itself into the folder.")


def _files_of(path: Path) -> list[Path]:
    try:
        table = read_unfinished(path)["patches"]
    except (GstError, OSError):
        return [path]
    return [path, *([Path(table)] if table is not None else [])]


def state_of(path: Path) -> dict[str, Any]:
    """The content of the page, ready for JSON. A missing value is null.

    Raises a `ConfigError` if the config or its table cannot be read.
    """
    # first: if a file changes meanwhile, saves are refused
    digest = digest_of(path)
    config = read_unfinished(path)
    rows, has_scans = rows_of(config)
    asked = [
        {"patch": patch, "column": column, "likely": likely[len(TODO) :].strip()}
        for column in EPOCHS
        for patch, likely in zip(rows.patch, rows[column], strict=True)
        if is_to_do(likely)
    ]
    placed = rows[_PLACE].astype(object).where(rows.notna(), None)
    return {
        "digest": digest,
        "title": config["title"],
        "mesh": config["inputs"] and Path(config["inputs"]["mesh"]).name,
        "square": {
            "points_mm": unless_to_do(config["square"]["points_mm"]),
            "size_mm": unless_to_do(config["square"]["size_mm"]),
        },
        "face_mm": config["macroscale"]["face_mm"],
        "patch_size_mm": unless_to_do(config["scans"]["size_mm"]),
        "has_scans": has_scans,
        "fewest": FEWEST_PATCHES,
        "patches": placed.to_dict("records"),
        "asked": asked,
        "files": _scan_names(config) if asked else [],
        "own_tool": "mesh" in (config["counterface"] or {}),
        "answers": {key: _value(config, key) for key in _ANSWERS},
    }


def _scan_names(config: Mapping) -> list[str]:
    """The names of all scans in their folder."""
    root, paths, _ = scans_in([Path(config["inputs"]["scan_folder"])])
    return [path.relative_to(root).as_posix() for path in paths]


def unless_to_do(value: Any) -> Any:
    """A value of the config; None while it is still to be given."""
    return None if is_to_do(value) else value


def _value(config: Mapping, key: str) -> Any:
    """The value at a key; None where a section is."""
    value: Any = config
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def rows_of(config: Mapping) -> tuple[pd.DataFrame, bool]:
    """The rows of the patch table, whatever is still wrong with them, and if they have scans."""
    if config["patches"] is None:
        return no_patches(), False
    table = read_rows(config["patches"], "patches")
    has_scans = (
        not {"t0", "t1"}.isdisjoint(table.columns) or "wear_grade" not in table.columns
    )
    rows = table.rows.reset_index(drop=True)
    if config["inputs"] is not None and has_scans:
        # names without a file are reported by the check
        list(find_scans(rows, table.columns, config["inputs"]["scan_folder"]))
    return rows, has_scans


def save_answers(path: Path, values: _Values) -> str | None:
    """Write values into the config, each by its key.

    Every save returns the name of a copy of the file of which a part was removed, if it was. It
    raises a `ConfigError` if a value cannot be meant, or is not one that the page asks for.
    """
    if others := {*values} - {*_ANSWERS}:
        raise ConfigError(
            path, f"is not asked for {sorted(others)}", "Reload the page."
        )
    values = dict(values)
    of_pressure = _value(read_unfinished(path), "load.pressure_MPa")
    if "load.force_N" in values and of_pressure is not None:
        values["load.pressure_MPa"] = None  # exactly one of them
    return _save_config(path, values)


def save_file(path: Path, patch: str, column: str, name: str) -> str | None:
    """Write which scan a patch has at an epoch, or "" for none.

    Raises a `ConfigError` if this is not asked for, or there is no such scan in the folder.
    """
    config, state = read_unfinished(path), state_of(path)
    asked = [(question["patch"], question["column"]) for question in state["asked"]]
    if (patch, column) not in asked or name not in ["", *state["files"]]:
        problem = f"does not need {column} of patch {patch}, or there is no scan {name}"
        raise ConfigError(config["patches"], problem, "Reload the page.")
    cells = {patch: {column: cell_of(name)}}
    return _write_cells(Path(config["patches"]), _by_patch(cells))


def save_cure(path: Path, values: _Values, cells: _Values, **_: Any) -> str | None:
    """Write the cure of a fault: values of the config by key, cells of the table by patch.

    The files are kept as they were beside them.
    """
    table = read_unfinished(path)["patches"]
    kept = [str(keep_copy(path))] if values else []
    if cells:
        kept.append(str(keep_copy(Path(table))))
        _write_cells(Path(table), _by_patch(cells))
    if values:
        _save_config(path, values)
    return " and ".join(kept)


def save_places(path: Path, square: _Values, patches: Sequence[Mapping]) -> str | None:
    """Write the square and the patches' places, or the places of a tool without scans.

    The face around the square grows and shrinks with it. Null is still to be given. Raises a
    `ConfigError` if a value is impossible, or the table has other patches.
    """
    config = read_unfinished(path)
    former, has_scans = rows_of(config)
    names = [row["patch"] for row in patches]
    is_other = has_scans and sorted(names) != sorted(former.patch)
    if is_other or len({*names}) < len(names):
        problem = f"has the patches {[*former.patch]}, and the page shows {names}"
        remedy = "Give each row a name of its own, then reload the page."
        raise ConfigError(config["patches"], problem, remedy)
    columns = ["x_mm", "y_mm"]
    if former.rotation_deg.any() or any(row["rotation_deg"] for row in patches):
        columns.append("rotation_deg")
    if not has_scans:
        columns.append("wear_grade")
    table = [_cells(row, columns) for row in patches]
    values = _of_square(config, square)
    if not has_scans:
        values["patches"] = str(config["patches"] or _TABLE) if patches else None
    changed = {
        key: value for key, value in values.items() if value != _value(config, key)
    }
    _checked(path, changed)  # before the table is written
    if not patches:  # a config never names a table that is gone
        _save_config(path, changed)
        return _remove_table(config["patches"])
    kept = _write_table(config["patches"], table)
    return _save_config(path, changed) or kept


def _of_square(config: Mapping, square: _Values) -> dict[str, Any]:
    """The values of a square, and of the face around it, whose ratio to the square it keeps."""
    points_mm, size_mm = square["points_mm"], square["size_mm"]
    values = {
        "square.size_mm": size_mm,
        "square.points_mm": TODO if points_mm is None else points_mm,
    }
    former_mm = unless_to_do(config["square"]["size_mm"])
    face_mm = config["macroscale"]["face_mm"]
    if former_mm and former_mm != size_mm and face_mm:
        ratio = size_mm / former_mm
        values["macroscale.face_mm"] = round(face_mm * ratio, DECIMALS)
    return values


def _save_config(path: Path, values: _Values) -> str | None:
    """Write values into the config; the name of a copy of it, if one of them was removed."""
    config, text = read_unfinished(path), _checked(path, values)
    former = {key: _value(config, key) for key in values}
    return _written(path, text, is_less=_loses(former, values))


def _written(path: Path, text: str, *, is_less: bool) -> str | None:
    """Write a file; the name of a copy of the former one, if a part of it was removed."""
    kept = str(keep_copy(path)) if is_less else None
    save_text(path, text)
    return kept


def _loses(former: _Values, new: _Values | None) -> bool:
    """Whether a value that was given goes; `new` is None if all go."""
    return new is None or any(
        _is_filled(former.get(key)) and not _is_filled(value)
        for key, value in new.items()
    )


def _is_filled(cell: object) -> bool:
    return cell not in (None, "") and not is_to_do(cell)


def _cells(row: _Values, columns: Sequence[str]) -> dict[str, str]:
    """A row as text; null is still to be given, a grade unknown."""
    cells = {"patch": row["patch"]}
    for column in columns:
        cells[column] = "" if column == "wear_grade" else TODO
        if row[column] is not None:
            cells[column] = f"{round(row[column], DECIMALS) + 0:.10g}"
    return cells


def _remove_table(table: str | None) -> str | None:
    """Remove the table, if there is one; the name of its copy."""
    if table is None or not Path(table).exists():
        return None
    kept = keep_copy(Path(table))
    Path(table).unlink()
    return str(kept)


def _write_table(former: str | None, rows: Sequence[Mapping[str, str]]) -> str | None:
    """Write the table with these rows; as `_write_cells`."""
    file = Path(former or _TABLE)
    if former is None:
        if os.path.lexists(file):
            problem = "exists, but the config does not name it"
            raise InputError(file, problem, "Rename it.")
        write_whole(file, f"{';'.join(rows[0])}\n".encode())
    left = {row["patch"]: row for row in rows}
    # each row takes its own out, and those that the table lacks come at its end
    return _write_cells(file, lambda row: left.pop(row["patch"], None), left.values())


def _by_patch(cells: Mapping[str, _Values]) -> Cells:
    """The changed cells of each row, from those of each patch."""
    return lambda row: cells.get(row["patch"], {})


def _write_cells(
    file: Path, cells: Cells, more: Collection[Mapping[str, str]] = ()
) -> str | None:
    """Write changed cells and further rows into a table.

    Returns the name of the copy of the former table, if rows or filled cells were removed.
    """
    losses = []

    def changed(row: Mapping[str, str]) -> Mapping[str, object] | None:
        new = cells(row)
        losses.append(_loses(row, new))
        return new

    text = with_cells(text_of(file), changed, more)
    return _written(file, text, is_less=any(losses))


def _checked(path: Path, values: _Values) -> str:
    """The config's text with these values; a `ConfigError` if one of them cannot be meant."""
    former = text_of(path)
    text = with_values(former, values)
    before, after = (
        value_problems(complete(parse_yaml(each, path))) for each in (former, text)
    )
    refuse_config([each for each in after if each not in before], str(path))
    return text


def stone_of(path: Path) -> dict[str, Any]:
    """The stone of a config, as `gst.page.viewer.stone_data` has it, and its ``colours``."""
    mesh = mesh_of(path)
    stone, colours = coarsen(mesh), None
    with contextlib.suppress(Exception):  # without them, the stone is grey
        file = Path(read_unfinished(path)["inputs"]["mesh"])
        colours = _colours_of(file, UNITS[mesh.metadata["file_unit"]], stone.vertices)
    return stone_data(stone) | {"colours": colours}


def _colours_of(file: Path, unit_mm: float, vertices: np.ndarray) -> str | None:
    """Red, green and blue (0 to 255) at vertices in mm, from the nearest ones of a file.

    None if it has no colours, or one alone. Pictures beside the file are not opened.
    """
    import trimesh
    from scipy.spatial import cKDTree

    content = io.BytesIO(file.read_bytes())
    scene: Any = trimesh.load_scene(content, file_type=file.suffix[1:], process=False)
    parts = [part for part in scene.dump() if part.visual.defined]
    looks = [part.visual for part in parts]
    looks = [look.to_color() if look.kind == "texture" else look for look in looks]
    rgb = np.concatenate([look.vertex_colors[:, :3] for look in looks])
    if not np.ptp(rgb, axis=0).any():
        return None
    points = unit_mm * np.concatenate([part.vertices for part in parts])
    return packed(rgb[cKDTree(points).query(vertices)[1]], "u1")


def mesh_of(path: Path) -> "trimesh.Trimesh":
    inputs = read_unfinished(path)["inputs"]
    if inputs is None:
        raise ConfigError(
            path, "names no mesh", "Give inputs.mesh, or begin with `gst new`."
        )
    if is_to_do(inputs["mesh_unit"]):
        raise ConfigError(
            path, "does not state the unit of the mesh", "Give it on this page."
        )
    mesh = Path(inputs["mesh"])
    return _read_once(mesh, inputs["mesh_unit"], version_of(mesh))


@functools.lru_cache(maxsize=1)
def _read_once(mesh: Path, unit: str | None, _version: object) -> "trimesh.Trimesh":
    return read_mesh(mesh, unit=unit)


def version_of(path: Path) -> object:
    """A mark that changes with the file; None if there is no file."""
    return (path.stat().st_mtime_ns, path.stat().st_size) if path.is_file() else None
