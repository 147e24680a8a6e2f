"""The patch table: where on the square each scan was taken, and which files it is in.

Text as spreadsheets write it, one row per patch: tabs, commas or semicolons separate the cells, as
the line of column names has them; but for commas, numbers may have decimal commas. ``#`` begins a
comment line. Columns: ``patch`` (id), ``x_mm``, ``y_mm`` (centre of the scan in the square's
frame), ``rotation_deg`` (about the normal, x towards y), ``t0``, ``t1`` (file names in the scan
folder), ``crop_x_mm``, ``crop_y_mm`` (centre of the piece to cut from the scan, from the scan's
centre), ``note``.
"""

import csv
import math
import re
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from gstlib.errors import ConfigError
from gstlib.io.text import separator_of

__all__ = ["natural_key", "read_patches", "readable_patches"]

# What tells which scan is to be looked at, and which piece of it.
_OF_THE_SCAN = {"t0", "t1", "crop_x_mm", "crop_y_mm"}
# A footprint may touch the square's edge; this much (mm) beyond it is rounding.
_EDGE_TOLERANCE = 1e-9


def read_patches(
    path: str | Path,
    *,
    schema: Mapping | str | Path,
    size_mm: float,
    patch_size_mm: float,
) -> pd.DataFrame:
    """Read and check the patch table.

    Parameters
    ----------
    path : str or Path
        .tsv, .csv or .txt file, UTF-8 or (with its mark) UTF-16.
    schema : mapping or path
        JSON schema of a row (a path: YAML or JSON), `workflow/schemas/patches.schema.yaml`. It
        sees numbers as numbers, and cells left empty as absent.
    size_mm, patch_size_mm : float
        Sides of the square and of a patch: every footprint must lie within [0, size]².

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
    path = Path(path)
    schema = _load_schema(schema)
    delimiter, columns, lines = _read_lines(path)
    _check_columns(path, columns, schema)
    rows, problems = _check_rows(columns, lines, schema, decimal_comma=delimiter != ",")
    problems += _duplicates(rows)
    problems += _out_of_square(rows, size_mm, patch_size_mm)
    if problems:
        problems = [text for _, text in sorted(problems, key=lambda problem: problem[0])]
        raise ConfigError(
            path,
            f"{len(problems)} problem{'s' if len(problems) > 1 else ''} in the patch table\n  - "
            + "\n  - ".join(problems)
            + "\n ",
            "Correct these rows; the columns are described in config/README.md.",
        )
    frame = _frame([row for _, row in rows], schema)
    return frame.sort_values("patch", key=lambda ids: ids.map(natural_key), ignore_index=True)


def readable_patches(path: str | Path, *, schema: Mapping | str | Path) -> pd.DataFrame:
    """The rows of a faulty patch table that name their scans, to look at these all the same.

    Parameters
    ----------
    path, schema
        As in `read_patches`.

    Returns
    -------
    pandas.DataFrame
        As of `read_patches`, in the order of the file, the first row of an id alone, and numbers
        that cannot be used NaN; without rows where nothing can be read.
    """
    from jsonschema import Draft202012Validator

    schema = _load_schema(schema)
    try:
        delimiter, columns, lines = _read_lines(Path(path))
        _check_columns(Path(path), columns, schema)
    except ConfigError:
        return _frame([], schema)
    rows: dict[str, dict] = {}
    for _, row in _check_rows(columns, lines, schema, decimal_comma=delimiter != ",")[0]:
        errors = list(Draft202012Validator(schema).iter_errors(row))
        faulty = {name for error in errors for name in error.absolute_path}
        crop = any(error.validator == "dependentRequired" for error in errors)
        if not crop and not faulty & _OF_THE_SCAN and {"patch", "t0"} <= set(row):
            sound = {name: row[name] for name in row if name == "patch" or name not in faulty}
            rows.setdefault(row["patch"].lower(), sound)
    return _frame(list(rows.values()), schema)


def _frame(rows: list[dict], schema: Mapping) -> pd.DataFrame:
    """The rows with every column of the schema, what is not given as its default or empty."""
    table = {}
    for name, rule in schema["properties"].items():
        empty = rule.get("default", "" if rule.get("type") == "string" else math.nan)
        values = [row.get(name, empty) for row in rows]
        table[name] = values if rule.get("type") == "string" else [float(v) for v in values]
    return pd.DataFrame(table)


def natural_key(text: str) -> tuple:
    """Sort key by which "2" comes before "10".

    >>> sorted(["10", "b2", "2", "b10"], key=natural_key)
    ['2', '10', 'b2', 'b10']
    """
    parts = re.split(r"(\d+)", text)
    return tuple((0, int(p), p) if p.isdigit() else (1, 0, p) for p in parts if p)


def _load_schema(schema: Mapping | str | Path) -> Mapping:
    if isinstance(schema, Mapping):
        return schema
    import yaml

    return yaml.safe_load(Path(schema).read_text(encoding="utf-8"))


def _read_lines(path: Path) -> tuple[str, list[str], list[tuple[int, list[str]]]]:
    """Delimiter, column names, and (line number, cells) of each row."""
    if not path.is_file():
        raise ConfigError(
            path, "no such file", "Correct the path of the patch table in the config."
        )
    if path.suffix.lower() not in (".tsv", ".csv", ".txt"):
        raise ConfigError(
            path,
            f"a patch table is .tsv, .csv or .txt, not '{path.suffix}'",
            "Save it as CSV.",
        )
    # a spreadsheet writes a cell with a comment in quotes, and blank rows as rows of empty cells
    lines = [
        (number, line)
        for number, line in enumerate(_text(path).splitlines(), start=1)
        if line.strip(" \t,;") and not line.lstrip(' "').startswith("#")
    ]
    if len(lines) < 2:
        raise ConfigError(
            path, "the table has no rows", "Give a line of column names and one line per patch."
        )
    delimiter = separator_of(lines[0][1]) or ","
    cells = [
        (number, _filled(next(csv.reader([line], delimiter=delimiter)))) for number, line in lines
    ]
    return delimiter, cells[0][1], cells[1:]


def _text(path: Path) -> str:
    content = path.read_bytes()
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise ConfigError(path, f"is not UTF-8 text ({error})", "Save it as UTF-8.") from error


def _filled(cells: list[str]) -> list[str]:
    """The cells up to the last that is not empty."""
    cells = [cell.strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _check_columns(path: Path, columns: list[str], schema: Mapping) -> None:
    known = list(schema["properties"])
    missing = [name for name in schema["required"] if name not in columns]
    unknown = [name for name in columns if name not in known]
    twice = sorted({name for name in columns if columns.count(name) > 1})
    problems = [
        f"{what} columns {names}"
        for what, names in (("missing", missing), ("unknown", unknown), ("repeated", twice))
        if names
    ]
    if problems:
        raise ConfigError(
            path,
            "; ".join(problems) + f" (found {columns})",
            f"Known columns: {known}, separated by tabs, commas or semicolons.",
        )


def _check_rows(
    columns, lines, schema, *, decimal_comma: bool
) -> tuple[list[tuple[int, dict]], list[tuple[int, str]]]:
    """Rows as (line number, values) and what the schema says against them."""
    from jsonschema import Draft202012Validator

    validator = Draft202012Validator(schema)
    rows, problems = [], []
    for number, cells in lines:
        if len(cells) > len(columns):
            problems.append(
                (number, f"line {number}: {len(cells)} cells in {len(columns)} columns")
            )
            continue
        row = {}
        for name, cell in zip(columns, cells, strict=False):
            if cell:
                is_text = schema["properties"][name].get("type") == "string"
                row[name] = cell if is_text else _number(cell, decimal_comma)
        label = f"line {number} (patch {row['patch']})" if "patch" in row else f"line {number}"
        # A row that lacks several columns makes one error for each, which say the same.
        found = dict.fromkeys(_explain(error, row) for error in validator.iter_errors(row))
        problems += [(number, f"{label}: {text}") for text in found]
        rows.append((number, row))
    return rows, problems


def _number(cell: str, decimal_comma: bool) -> float | str:
    try:
        value = float(cell.replace(",", ".") if decimal_comma else cell)
    except ValueError:
        return cell
    return value if math.isfinite(value) else cell


def _explain(error, row: dict) -> str:
    if error.validator == "required":
        lacking = [name for name in error.validator_value if name not in row]
        return f"lacks {', '.join(lacking)}"
    if error.validator == "dependentRequired":
        return "crop_x_mm and crop_y_mm go together: give both or neither"
    name = str(error.absolute_path[-1]) if error.absolute_path else "row"
    if error.validator == "type":
        return f"{name} is {error.instance!r}, not a number"
    wish = error.schema.get("description")
    return f"{name} is {error.instance!r}: {error.message}" + (f" [{wish}]" if wish else "")


def _duplicates(rows: list[tuple[int, dict]]) -> list[tuple[int, str]]:
    """Ids met before; case does not count, as some file systems do not tell it apart."""
    seen: dict[str, int] = {}
    problems = []
    for number, row in rows:
        if "patch" not in row:
            continue
        first = seen.setdefault(row["patch"].lower(), number)
        if first != number:
            problems.append(
                (number, f"line {number} (patch {row['patch']}): same id as in line {first}")
            )
    return problems


def _out_of_square(rows, size: float, patch_size: float) -> list[tuple[int, str]]:
    problems = []
    for number, row in rows:
        x, y, rotation = row.get("x_mm"), row.get("y_mm"), row.get("rotation_deg", 0.0)
        if not all(isinstance(value, float) for value in (x, y, rotation)):
            continue
        angle = math.radians(rotation)
        half = patch_size / 2 * (abs(math.cos(angle)) + abs(math.sin(angle)))
        beyond = [
            f"{over:.4g} mm at the {side} side"
            for side, over in (
                ("x = 0", half - x),
                (f"x = {size:g}", x + half - size),
                ("y = 0", half - y),
                (f"y = {size:g}", y + half - size),
            )
            if over > _EDGE_TOLERANCE
        ]
        if beyond:
            problems.append(
                (
                    number,
                    f"line {number} (patch {row.get('patch', '?')}): its footprint of "
                    f"{patch_size:g} mm sticks out of the {size:g} mm square by "
                    + " and ".join(beyond),
                )
            )
    return problems
