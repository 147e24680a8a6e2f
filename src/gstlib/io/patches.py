"""The patch table: where on the square each scan was taken, and in which files it is.

Text as spreadsheets write it, one row per patch. Tabs, commas or semicolons separate the cells, as
in the line of column names; except between commas, numbers may have decimal commas. ``#`` begins a
comment line. Columns: ``patch`` (id), ``x_mm``, ``y_mm`` (centre of the scan in the square's
frame), ``rotation_deg`` (about the normal, x towards y), ``t0``, ``t1`` (file names in the scan
folder), ``crop_x_mm``, ``crop_y_mm`` (centre of the piece to cut from the scan, from the scan's
centre), ``note``.
"""

import csv
import itertools
import math
import re
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import yaml

from gstlib.errors import ConfigError
from gstlib.io.text import separator_of

if TYPE_CHECKING:
    from jsonschema import ValidationError

__all__ = ["read_patches"]

# A footprint may touch the square's edge; this much (mm) beyond it is rounding.
_EDGE_TOLERANCE = 1e-9
# First bytes of .xlsx and .ods, and of .xls.
_SPREADSHEETS = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"

_Rows = dict[int, dict[str, Any]]  # cells by column, by line number
_Problems = list[tuple[int, str]]  # line number and text


def read_patches(
    path: str | Path,
    *,
    schema: str | Path,
    size_mm: float,
    patch_size_mm: float,
    scan_folder: str | Path | None = None,
) -> pd.DataFrame:
    """Read and check the patch table.

    Parameters
    ----------
    path : str or Path
        .tsv, .csv or .txt file, UTF-8 or (with its mark) UTF-16.
    schema : path
        JSON schema of a row (YAML), `workflow/schemas/patches.schema.yaml`. It sees numbers as
        numbers, and empty cells as absent.
    size_mm, patch_size_mm : float
        Sides of the square and of a patch: every footprint must lie within [0, size]².
    scan_folder : path, optional
        Folder of the scans. Their names come back with accents composed as in the folder.

    Returns
    -------
    pandas.DataFrame
        One row per patch, in natural order of ids ("2" before "10"), with every column of the
        schema: text "" and numbers NaN where not given, unless the schema has a default.

    Raises
    ------
    ConfigError
        Its message lists all that is wrong, with line numbers.
    """
    row_schema = yaml.safe_load(Path(schema).read_text(encoding="utf-8"))
    rows, problems = _read_rows(Path(path), row_schema)
    problems += _out_of_square(rows, size_mm, patch_size_mm)
    problems += _overlapping(rows, patch_size_mm)
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise ConfigError(
            path,
            f"{len(problems)} problem{'s' if len(problems) > 1 else ''} in the patch table"
            + "".join(f"\n  - line {number}{text}" for number, text in problems)
            + "\n ",
            "Correct these rows; the columns are described in config/README.md.",
        )
    table = {}
    for name, rule in row_schema["properties"].items():
        is_text = rule["type"] == "string"
        empty = rule.get("default", "" if is_text else math.nan)
        values = [row.get(name, empty) for row in rows.values()]
        if scan_folder is not None and name in ("t0", "t1"):
            values = [_as_in_folder(value, Path(scan_folder)) for value in values]
        table[name] = values if is_text else [float(value) for value in values]
    frame = pd.DataFrame(table)
    return frame.sort_values("patch", key=lambda ids: ids.map(_natural_key), ignore_index=True)


def _as_in_folder(name: str, folder: Path) -> str:
    """The name of a file as its folder spells it: é is one character, or e and an accent."""
    path = folder / name
    if name and not path.exists() and path.parent.is_dir():
        for there in path.parent.iterdir():
            if unicodedata.normalize("NFC", there.name) == unicodedata.normalize("NFC", path.name):
                return str(Path(name).with_name(there.name))
    return name


def _natural_key(text: str) -> tuple:
    """Sort key by which "2" comes before "10".

    >>> sorted(["10", "b2", "2", "b10"], key=_natural_key)
    ['2', '10', 'b2', 'b10']
    """
    parts = re.split(r"(\d+)", text)
    return tuple((0, int(p), p) if p.isdigit() else (1, 0, p) for p in parts if p)


def _read_rows(path: Path, schema: Mapping) -> tuple[_Rows, _Problems]:
    """The rows, and what is wrong with each of them."""
    from jsonschema import Draft202012Validator

    lines = _read_lines(path)
    header = lines[0][1]
    delimiter = separator_of(header) or ","
    # A spreadsheet ends every line with as many empty cells as its widest row has.
    columns = _cells(header.rstrip(f" {delimiter}"), delimiter)
    known = schema["properties"]
    missing = [name for name in schema["required"] if name not in columns]
    unknown = [name for name in columns if name not in known]
    if missing or unknown:
        raise ConfigError(
            path,
            f"missing columns {missing}, unknown columns {unknown} (found {columns})",
            f"Known columns: {list(known)}, separated by tabs, commas or semicolons.",
        )
    validator = Draft202012Validator(schema)
    rows: _Rows = {}
    problems: _Problems = []
    first_line: dict[str, int] = {}
    for number, line in lines[1:]:
        cells = _cells(line, delimiter)
        row: dict[str, Any] = {}
        for name, cell in zip(columns, cells, strict=False):
            if cell:
                row[name] = cell if known[name]["type"] == "string" else _number(cell, delimiter)
        found = [_explain(error) for error in validator.iter_errors(row)]
        if any(cells[len(columns) :]):
            found.append(f"{len(cells)} cells in {len(columns)} columns")
        # Case does not count, because some file systems ignore it.
        first = first_line.setdefault(str(row.get("patch", number)).lower(), number)
        if first != number:
            found.append(f"same id as in line {first}")
        problems += [(number, f"{_patch(row)}: {text}") for text in found]
        rows[number] = row
    return rows, problems


def _read_lines(path: Path) -> list[tuple[int, str]]:
    """Numbered lines with content: the column names, then the rows."""
    if not path.is_file():
        raise ConfigError(
            path, "no such file", "Correct the path of the patch table in the config."
        )
    content = path.read_bytes()
    if content.startswith(_SPREADSHEETS):
        raise ConfigError(path, "is a spreadsheet, not text", "Save it as CSV from its program.")
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        raise ConfigError(path, f"is not UTF-8 text ({error})", "Save it as UTF-8 CSV.") from error
    # A spreadsheet puts a comment in quotes, and writes blank rows as rows of empty cells.
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip(" \t,;") and not line.lstrip(' "').startswith("#")
    ]
    if len(lines) < 2:
        raise ConfigError(
            path, "the table has no rows", "Give a line of column names and one line per patch."
        )
    return lines


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float | str:
    """The number in a cell; the cell itself if it holds none, or one that is not finite."""
    try:
        value = float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return cell
    return value if math.isfinite(value) else cell


def _patch(row: Mapping) -> str:
    return f" (patch {row['patch']})" if "patch" in row else ""


def _explain(error: "ValidationError") -> str:
    if not error.absolute_path:  # a cell is absent, which the message names
        return error.message
    name = error.absolute_path[-1]
    if error.validator == "type":
        return f"{name} is {error.instance!r}, not a number"
    # a pattern is for the machine
    said = "" if error.validator == "pattern" else f": {error.message}"
    return f"{name} is {error.instance!r}{said} [{error.schema['description']}]"


def _overlapping(rows: _Rows, patch_size: float) -> _Problems:
    """Patches whose centres are nearer to each other than half of a side."""
    known = [
        (number, row)
        for number, row in rows.items()
        if isinstance(row.get("x_mm"), float) and isinstance(row.get("y_mm"), float)
    ]
    return [
        (
            number,
            f"{_patch(row)}: its centre is {apart:.4g} mm from that of line {line}{_patch(other)}, "
            f"and a patch is {patch_size:g} mm wide: leave one of them out, or correct "
            "their positions",
        )
        for (line, other), (number, row) in itertools.combinations(known, 2)
        if (apart := math.hypot(row["x_mm"] - other["x_mm"], row["y_mm"] - other["y_mm"]))
        < patch_size / 2
    ]


def _out_of_square(rows: _Rows, size: float, patch_size: float) -> _Problems:
    problems = []
    for number, row in rows.items():
        x, y, rotation = row.get("x_mm"), row.get("y_mm"), row.get("rotation_deg", 0.0)
        if not (isinstance(x, float) and isinstance(y, float) and isinstance(rotation, float)):
            continue
        angle = math.radians(rotation)
        half = patch_size / 2 * (abs(math.cos(angle)) + abs(math.sin(angle)))
        over = {
            "x = 0": half - x,
            f"x = {size:g}": x + half - size,
            "y = 0": half - y,
            f"y = {size:g}": y + half - size,
        }
        beyond = [f"{mm:.4g} mm at the {s} side" for s, mm in over.items() if mm > _EDGE_TOLERANCE]
        if beyond:
            text = (
                f"{_patch(row)}: its footprint of {patch_size:g} mm sticks out of the {size:g} mm "
                f"square by {' and '.join(beyond)}"
            )
            problems.append((number, text))
    return problems
