"""The patch table: where on the square each scan was taken, and which files hold it.

Text as spreadsheets write it, one row per patch. Tabs, commas or semicolons separate the cells, as
in the line of column names; unless commas separate them, numbers may have decimal commas. ``#``
begins a comment line. Columns: ``patch`` (id), ``x_mm``, ``y_mm`` (centre of the scan in the
square's frame), ``rotation_deg`` (about the normal, x towards y), ``flip`` (in place of the
config's), ``t0``, ``t1``, ``repeat`` (file names in the scan folder), ``crop_x_mm``, ``crop_y_mm``
(centre of the piece to cut from the scans, from their centre), ``note``.

A name with ``*`` is that of the one file that fits it, where ``{patch}`` stands for the patch.

The table of proposed places (``places.csv``) is a patch table, too: ``place`` stands for ``patch``,
and its other columns are for readers. In a table without ``t0`` and ``t1``, a patch's scans are
those named after it and the epoch: ``E1_T0.plux`` and, if they are there, ``E1_T1.plux`` and
``E1_repeat.plux``.
"""

import csv
import math
import re
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from gst import ROOT
from gst.tables import columns_of
from gstlib.errors import ConfigError
from gstlib.io.files import LARGEST_TABLE, check_size, name_problem
from gstlib.io.text import decoded, other_case, separator_of
from gstlib.surfaces.footprints import Place, outline, places_of

if TYPE_CHECKING:
    from jsonschema import ValidationError

__all__ = [
    "COUNTERFACE",
    "EPOCHS",
    "REPEAT",
    "ScanFile",
    "at_epoch",
    "no_patches",
    "overlaps",
    "read_patches",
    "scan_files",
]

# Cells are converted, and empty ones dropped, before validation.
_SCHEMA = ROOT / "workflow/schemas/patches.schema.yaml"
COUNTERFACE = "counterface"  # in place of a patch's name
# Epochs of a patch's scans, by their columns of the table. The repeat is a second scan without use.
REPEAT = "repeat"
EPOCHS = {"t0": "T0", "t1": "T1", "repeat": REPEAT}
# What the scans of a synthetic specimen are.
_GENERATED = ".plu"
# A footprint may touch the square's edge; up to this much (mm) beyond it is rounding.
_ROUNDING = 1e-9
# Patches that overlap by less (share of a patch) lie side by side: places are rounded.
_LEAST_OVERLAP = 0.01
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
# Rows of a table: a square of 5 mm holds some forty patches side by side.
_MOST_PATCHES, _LONGEST_LINE = 10_000, 10_000
# First bytes of .xlsx and .ods, and of .xls.
_SPREADSHEETS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"


def read_patches(
    path: str | Path,
    *,
    size_mm: float,
    patch_size_mm: float,
    scan_folder: str | Path | None = None,
) -> pd.DataFrame:
    """Read and check the patch table; `workflow/schemas/patches.schema.yaml` describes a row.

    Parameters
    ----------
    path : str or Path
        .tsv, .csv or .txt file, UTF-8 or (with its mark) UTF-16.
    size_mm, patch_size_mm : float
        Sides of the square and of a patch: every footprint must lie within [0, size]².
    scan_folder : path, optional
        Folder of the scans. Their names are returned with accents composed as in the folder.

    Returns
    -------
    pandas.DataFrame
        One row per patch, in natural order of ids ("2" before "10"), with every column of the
        schema: missing text is "" and missing numbers are NaN, unless the schema has a default.

    Raises
    ------
    ConfigError
        Its message lists all that is wrong, with line numbers.
    """
    row_schema = yaml.safe_load(_SCHEMA.read_text(encoding="utf-8"))
    folder = None if scan_folder is None else Path(scan_folder)
    rows, problems = _read_rows(Path(path), row_schema, folder)
    problems += _out_of_square(rows, size_mm, patch_size_mm)
    problems += _overlapping(rows, patch_size_mm)
    if problems:
        named = []
        for line, text in sorted(problems, key=lambda problem: problem[0]):
            patch = rows[line].get("patch")
            named.append(f"\n  - line {line}{f' (patch {patch})' if patch else ''}: {text}")
        raise ConfigError(
            path,
            f"{len(problems)} problem{'s' if len(problems) > 1 else ''} in the patch table"
            f"{''.join(named)}\n ",
            "Correct these rows; the columns are described in config/README.md.",
        )
    table = _table(rows.values(), row_schema)
    if folder is not None:
        for name in EPOCHS:
            table[name] = [_as_in_folder(value, folder) for value in table[name]]
    # natural order: numbers within a name are padded to equal length
    return table.sort_values(
        "patch",
        key=lambda ids: ids.str.replace(r"\d+", lambda found: found[0].zfill(20), regex=True),
        kind="stable",
        ignore_index=True,
    )


def overlaps(patches: pd.DataFrame, size_mm: float) -> Iterator[tuple[str, str, float]]:
    """Two patches, and the share (0 to 1) of each that they have in common, if more than 1 %."""
    from shapely import Polygon, STRtree

    places = places_of(patches)
    names = list(places)
    outlines = [Polygon(outline(place, size_mm)) for place in places.values()]
    pairs = STRtree(outlines).query(outlines, predicate="intersects").T if names else ()
    for one, other in sorted(map(tuple, pairs)):
        share = outlines[one].intersection(outlines[other]).area / size_mm**2
        if one < other and share > _LEAST_OVERLAP:
            yield names[one], names[other], share


def no_patches() -> pd.DataFrame:
    """The patch table of a study before anything is scanned: no rows."""
    return _table([], yaml.safe_load(_SCHEMA.read_text(encoding="utf-8")))


def _table(rows: Collection[Mapping], schema: Mapping) -> pd.DataFrame:
    """Every column of the schema, filled where a row has no cell."""
    table = pd.DataFrame()
    for name, rule in schema["properties"].items():
        is_text = rule["type"] == "string"
        empty = rule.get("default", "" if is_text else math.nan)
        values = [row.get(name, empty) for row in rows]
        table[name] = pd.Series(values, dtype=str if is_text else float)
    return table


class ScanFile(NamedTuple):
    """A scan that the study uses.

    Attributes
    ----------
    path : Path
    patch : str
        Patch, or `COUNTERFACE`.
    epoch : str
        T0, T1, repeat, or empty.
    crop : (y, x) or None
        Centre (mm) of the piece to cut, from the scan's centre; None for the whole scan.
    place : Place or None
        Where it lies on the square.
    flip : {"", "x", "y", "none"}
        As in the table.
    """

    path: Path
    patch: str
    epoch: str
    crop: tuple[float, float] | None = None
    place: Place | None = None
    flip: str = ""


def scan_files(
    patches: pd.DataFrame, folder: str | Path, counterface: str | Path | None
) -> list[ScanFile]:
    """Every scan in `folder` that the table of `read_patches` names, and the counterface's."""
    scans = []
    for row in patches.itertuples():
        crop = None if math.isnan(row.crop_x_mm) else (row.crop_y_mm, row.crop_x_mm)
        place = Place(row.y_mm, row.x_mm, row.rotation_deg)
        for column, epoch in EPOCHS.items():
            if name := getattr(row, column):
                use = row.patch, epoch, crop, place, row.flip
                scans.append(ScanFile(Path(folder) / name, *use))
    return scans + ([ScanFile(Path(counterface), COUNTERFACE, "")] if counterface else [])


def at_epoch(patch: str, epoch: str) -> str:
    """A patch's scan in words."""
    return f"repeat of patch {patch}" if epoch == REPEAT else f"patch {patch} at {epoch}"


def _as_in_folder(name: str, folder: Path) -> str:
    """The name of a file as its folder spells it: é is one character, or e and an accent."""
    path = folder / name
    if name and not path.exists() and path.parent.is_dir():
        for there in path.parent.iterdir():
            if unicodedata.normalize("NFC", there.name) == unicodedata.normalize(
                "NFC", path.name
            ):
                return str(Path(name).with_name(there.name))
    return name


def _read_rows(
    path: Path, schema: Mapping, folder: Path | None
) -> tuple[dict[int, dict[str, Any]], list[tuple[int, str]]]:
    """Each row's cells by column, by line number; and all problems, each with its line number."""
    from jsonschema import Draft202012Validator

    (_, header), *lines = _read_lines(path)
    delimiter = separator_of(header) or ","
    # A spreadsheet fills every line with empty cells, up to the length of its widest row.
    columns = _cells(header.rstrip(f" {delimiter}"), delimiter)
    known = schema["properties"]
    for_readers: set[str] = set()
    if "place" in columns and "patch" not in columns:
        columns[columns.index("place")] = "patch"
        for_readers = set(columns_of("places")) - set(known)
    named = {"t0", "t1"}.isdisjoint(columns)  # after the patch
    missing = [name for name in schema["required"] if name not in columns]
    missing = [name for name in missing if not (named and name == "t0")]
    unknown = [name for name in columns if name not in known and name not in for_readers]
    if missing or unknown:
        raise ConfigError(
            path,
            f"missing columns {missing}, unknown columns {unknown} (found {columns})",
            other_case(unknown, known)
            + f"Known columns: {list(known)}, separated by tabs, commas or semicolons.",
        )
    if delimiter == ",":
        _refuse_decimal_commas(path, columns, lines)
    validator = Draft202012Validator(schema)
    rows: dict[int, dict[str, Any]] = {}
    problems: list[tuple[int, str]] = []
    first_line: dict[str, int] = {}
    for number, line in lines:
        cells = _cells(line, delimiter)
        row = rows[number] = {
            name: cell if known[name]["type"] == "string" else _number(cell, delimiter)
            for name, cell in zip(columns, cells, strict=False)
            if cell and name in known
        }
        if unusable := [
            f"{name} {problem}"
            for name in ("patch", *EPOCHS)
            if (problem := name_problem(row.get(name, "")))
        ]:
            problems += [(number, text) for text in unusable]
            continue
        try:
            if named and "patch" in row:
                row |= _scans_named(row["patch"], folder) | row  # named files come first
            row |= _scans_fitting(row, folder)
        except ConfigError as error:
            problems.append((number, f"{error.problem}: {error.remedy}"))
            continue
        problems += [(number, _explain(error)) for error in validator.iter_errors(row)]
        if any(cells[len(columns) :]):
            problems.append((number, f"{len(cells)} cells in {len(columns)} columns"))
        # Case is ignored, as some file systems do.
        first = first_line.setdefault(str(row.get("patch", number)).lower(), number)
        if first != number:
            problems.append((number, f"same id as in line {first}"))
    return rows, problems


def _refuse_decimal_commas(
    path: Path, columns: list[str], lines: list[tuple[int, str]]
) -> None:
    """Where commas separate the cells, a decimal comma splits a number, unless it is quoted."""
    for number, line in lines:
        cells, x = _cells(line, ","), columns.index("x_mm")
        is_split = len(cells) > len(columns) and all(map(str.isdecimal, cells[x : x + 4]))
        if is_split or any(map(_DECIMAL_COMMA.fullmatch, cells[x : x + 1])):
            raise ConfigError(
                path,
                f"has decimal commas, as in line {number} ({line}), and commas between the cells",
                "Separate the cells by semicolons or tabs, or write decimal points.",
            )


def _scans_named(patch: str, folder: Path | None) -> dict[str, str]:
    """The scans named after a patch, by epoch; those of a specimen where there is no folder."""
    found = {}
    for column, epoch in EPOCHS.items():
        if folder is None and epoch == REPEAT:
            continue  # a specimen has those that its table names
        name = f"{patch}_{epoch}"
        there = [f"{name}{_GENERATED}"]
        if folder is not None:
            there = _fitting(f"{name}.*", folder)
        if len(there) > 1 or (epoch == "T0" and not there):
            problem = f"{', '.join(there) or 'no file'} in {folder} is named {name}"
            remedy = "name its one scan so, or add the columns t0 and t1"
            raise ConfigError(str(folder), problem, remedy)
        if there:
            found[column] = there[0]
    return found


def _scans_fitting(row: Mapping[str, Any], folder: Path | None) -> dict[str, str]:
    """The one file that fits each name with ``*`` in a row, by column."""
    found = {}
    for column in EPOCHS:
        if folder is not None and "*" in (name := row.get(column, "")):
            name = name.replace("{patch}", row.get("patch", ""))
            there = _fitting(name, folder)
            if len(there) != 1:
                fits = (
                    f"{' and '.join(there)} in {folder} fit"
                    if there
                    else f"no file in {folder} fits"
                )
                problem = f"{column} is {row[column]!r}, and {fits} {name}"
                raise ConfigError(str(folder), problem, "let it fit one file")
            found[column] = there[0]
    return found


def _fitting(name: str, folder: Path) -> list[str]:
    """The files whose names fit one with ``*``, whatever their capitals."""
    place = folder / name
    files = place.parent.iterdir() if place.parent.is_dir() else ()
    there = (f.name for f in files if fnmatch(f.name.lower(), place.name.lower()))
    return sorted(str(Path(name).with_name(file)) for file in there)


def _read_lines(path: Path) -> list[tuple[int, str]]:
    """Numbered lines with content: the column names, then the rows."""
    try:
        check_size(path, LARGEST_TABLE)
        content = path.read_bytes()
        if content.startswith(_SPREADSHEETS):
            raise ConfigError(
                path, "is a spreadsheet, not text", "Save it as CSV from its program."
            )
        text = decoded(content)
    except (OSError, UnicodeDecodeError) as error:
        remedy = "Correct its path in the config, or save it as UTF-8 CSV."
        raise ConfigError(path, f"cannot be read ({error})", remedy) from error
    # A spreadsheet puts a comment in quotes, and writes blank rows as rows of empty cells.
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip(" \t,;") and not line.lstrip(' "').startswith("#")
    ]
    if long := [number for number, line in lines if len(line) > _LONGEST_LINE]:
        problem = f"line {long[0]} has more than {_LONGEST_LINE} characters"
        raise ConfigError(path, problem, "Give each patch a line of its own.")
    if not 2 <= len(lines) <= _MOST_PATCHES + 1:
        raise ConfigError(
            path,
            f"the table has {max(len(lines) - 1, 0) or 'no'} rows",
            f"Give a line of column names and one line per patch, at most {_MOST_PATCHES}.",
        )
    return lines


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float | str:
    """The number in a cell; the cell itself if it is not a finite number."""
    try:
        value = float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return cell
    return value if math.isfinite(value) else cell


def _explain(error: "ValidationError") -> str:
    if not error.absolute_path:  # a cell is absent, which the message names first
        name, *given = error.message.split("'")[1::2]
        if name == "t0":
            given = [column for column in EPOCHS if column in error.instance]
        return f"{name} is empty" + (f", but {given[0]} is given" if given else "")
    name = error.absolute_path[-1]
    if error.validator == "type":
        return f"{name} is {error.instance!r}, not a number"
    # a pattern is for the machine
    said = "" if error.validator == "pattern" else f": {error.message}"
    return f"{name} is {error.instance!r}{said} [{error.schema['description']}]"


def _overlapping(rows: Mapping[int, Mapping], patch_size: float) -> Iterator[tuple[int, str]]:
    """Patches whose centre is less than half a side from that of one above them."""
    lines, centres = list(rows), np.array([_numbers(row)[:2] for row in rows.values()])
    for n, line in enumerate(lines[1:], start=1):
        apart = np.hypot(*(centres[:n] - centres[n]).T)
        nearest = int(np.argmin(np.where(np.isnan(apart), np.inf, apart)))
        if apart[nearest] < patch_size / 2:
            first = lines[nearest]
            yield (
                line,
                f"its centre is {apart[nearest]:.4g} mm from that of line {first} (patch "
                f"{rows[first].get('patch')}), and a patch is {patch_size:g} mm wide: leave one "
                "of them out, or correct their positions",
            )


def _out_of_square(
    rows: Mapping[int, Mapping], size: float, patch_size: float
) -> Iterator[tuple[int, str]]:
    """Patches whose footprint is not within the square."""
    for line, row in rows.items():
        x, y, rotation = _numbers(row)
        angle = math.radians(rotation)
        half = patch_size / 2 * (abs(math.cos(angle)) + abs(math.sin(angle)))
        over = {"x = 0": half - x, f"x = {size:g}": x + half - size}
        over |= {"y = 0": half - y, f"y = {size:g}": y + half - size}
        if beyond := [
            f"{mm:.4g} mm at the {s} side" for s, mm in over.items() if mm > _ROUNDING
        ]:
            yield (
                line,
                f"its footprint of {patch_size:g} mm sticks out of the {size:g} mm square by "
                f"{' and '.join(beyond)}",
            )


def _numbers(row: Mapping) -> list[float]:
    """x, y and rotation of a row; where it has no number, NaN, which no comparison exceeds."""
    cells = (row.get("x_mm"), row.get("y_mm"), row.get("rotation_deg", 0.0))
    return [cell if isinstance(cell, float) else math.nan for cell in cells]
