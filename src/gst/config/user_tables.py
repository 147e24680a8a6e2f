"""Tables that a user writes, each row checked against a schema: patches, poses, published values.

The first sheet of an .xlsx workbook, or text as spreadsheets write it: in UTF-8, in UTF-16 with its
mark, or in code page 1252, as Windows does in the west. Tabs, commas or semicolons separate the
cells, as in the line of column names; unless commas separate them, numbers may have decimal commas.
Each row has as many cells as there are columns. ``#`` begins a comment line.
`workflow/schemas/NAME.schema.yaml` describes a row: its columns, their types and bounds, and what
stands for an empty cell.
"""

import codecs
import csv
import functools
import io
import itertools
import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from gst import ROOT
from gst.config.tables import columns_of
from gst.config.todo import is_to_do, sentence
from gstlib.errors import ConfigError, InputError
from gstlib.io.containers import plain_zip
from gstlib.io.files import LARGEST_TABLE, check_size
from gstlib.io.instruments import plain_text
from gstlib.io.text_rows import FORMULA_ERROR, separator_of

# What every program reads as this number; Python's float takes 1_5, nan and digits of all scripts.
_NUMBER = re.compile(r"[-+]?([0-9]++\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
# A square of 5 mm holds some forty patches side by side; a gesture has some hundred poses.
_MOST_ROWS = 10_000
# Columns of a workbook, and letters in all its cells.
_MOST_COLUMNS, _MOST_LETTERS = 100, 5 * LARGEST_TABLE
_LAST_ROW = 1 << 20  # of a spreadsheet
# Problems in a message; who has corrected them is shown the next ones.
_MOST_LISTED = 50

Problem = tuple[int, str]  # a line number and its problem


class Record(NamedTuple):
    """A row of a table in text, in one line or more; or a comment, or a blank line."""

    text: str  # with its line end
    cells: list[str]
    line: int  # the number of its last line

    @property
    def is_row(self) -> bool:
        return any(self.cells) and not _is_comment(self.cells[0])


class UserTable(NamedTuple):
    """A table as it was read."""

    path: Path
    columns: list[str]  # that the file has
    # Every column of the schema, by line number. Missing text is "" and missing numbers are NaN,
    # unless the schema has a default.
    rows: pd.DataFrame
    problems: list[Problem]

    def refuse(self, more: Iterable[Problem] = ()) -> None:
        """Raise a `ConfigError` that lists all problems, and `more`, if there are any."""
        problems = sorted([*self.problems, *more], key=lambda problem: problem[0])
        listed = ""
        for line, text in problems[:_MOST_LISTED]:
            patch = self.rows.loc[line].get("patch")
            listed += f"\n  - line {line}{f' (patch {patch})' if patch else ''}: {text}"
        if listed:
            count = f"{len(problems)} problem{'s' * (len(problems) > 1)}"
            listed += "\n  - and others" * (len(problems) > _MOST_LISTED)
            raise ConfigError(
                self.path,
                f"{count} in this table{listed}\n ",
                "Correct these rows. config/README.md describes the columns. Between cells, "
                "commas leave no room for decimal commas: use semicolons or tabs.",
            )


def read_rows(path: str | Path, name: str) -> UserTable:
    """Read a table whose rows the schema `name` describes, and check each row.

    A table of proposed places is a patch table, too; its other columns are for readers. Raises a
    `ConfigError` if it is no text, or has no rows, or not the columns.
    """
    path, schema = Path(path), _schema(name)
    rules = schema["properties"]
    header, mark, lines = _read_lines(path)
    columns = _columns(path, header, schema)
    numeric = {name for name, rule in rules.items() if rule["type"] != "string"}
    validator = Draft202012Validator(schema)
    rows: dict[int, dict[str, Any]] = {}
    problems: list[Problem] = []
    numbers = []
    for line, cells in lines:
        row = rows[line] = {}
        for column, cell in zip(columns, cells, strict=False):
            if column in numeric:
                numbers.append((line, column, cell))
            if cell and column in rules:
                row[column] = _number(cell, mark) if column in numeric else cell
        problems += [(line, _explain(error)) for error in validator.iter_errors(row)]
        if len(cells) < len(columns) or any(cells[len(columns) :]):
            problems.append((line, f"{len(cells)} cells in {len(columns)} columns"))
    if mark in (";", "\t") and any("," in cell for *_, cell in numbers):
        # beside these, a point may separate thousands
        problems += [
            (line, f"{column} is {cell!r}, and others have decimal commas")
            for line, column, cell in numbers
            if "." in cell and _NUMBER.fullmatch(cell)
        ]
    return UserTable(path, columns, rows_of(name, rows), problems)


def _columns(path: Path, header: Sequence[str], schema: Mapping[str, Any]) -> list[str]:
    """The columns of a table by their names in the schema."""
    rules = schema["properties"]
    ignored = columns_of("places") if "patch" in schema["required"] else []
    names = {alike(name): name for name in [*ignored, *rules]}
    columns = [names.get(name, name) for name in column_names(path, header)]
    missing = [column for column in schema["required"] if column not in columns]
    unknown = [column for column in columns if column not in {*rules, *ignored}]
    if missing or unknown:
        raise ConfigError(
            path,
            f"missing columns {missing}, unknown columns {unknown} (found {header})",
            f"Known columns: {list(rules)}, separated by tabs, commas or semicolons.",
        )
    return columns


def column_names(source: str | Path, header: Sequence[str]) -> list[str]:
    """The names of columns in whatever capitals; that of a place is a patch.

    Raises a `ConfigError`, which calls the table `source`, if a column is given twice.
    """
    names = [alike(column) for column in header]
    if "patch" not in names:
        names = ["patch" if name == "place" else name for name in names]
    for n, name in enumerate(names):
        if name and name in names[:n]:
            same = f"{header[names.index(name)]!r} and {header[n]!r}"
            problem = f"has two columns of one name, {same}"
            raise ConfigError(source, problem, "Remove one of them, or rename it.")
    return names


def cells_to_do(path: str | Path, name: str) -> Iterator[str]:
    """A sentence for the cells of a table that are still to be filled in, by column."""
    try:
        header, _, lines = _read_lines(Path(path))
    except InputError:  # which is said where the table is read
        return
    rules = _schema(name)["properties"]
    for n, column in enumerate(header):
        cells = {
            line: row[n] for line, row in lines if n < len(row) and is_to_do(row[n])
        }
        if cells:
            where = f"line {min(cells)}"
            if len(cells) > 1:
                where = f"{len(cells)} lines from {min(cells)} to {max(cells)}"
            meaning = rules.get(column, {}).get("description", "")
            likely = cells[min(cells)]
            yield sentence(f"{path}, {column} in {where},", likely, meaning)


def rows_of(name: str, rows: Mapping[int, Mapping[str, Any]]) -> pd.DataFrame:
    """Rows with every column of a schema, as in `UserTable`."""
    rules = _schema(name)["properties"]
    table = pd.DataFrame([*rows.values()], [*rows], [*rules], dtype=object)
    for column, rule in rules.items():
        if rule["type"] == "string":
            table[column] = table[column].fillna("").astype(str)
        else:
            cells = table[column].fillna(rule.get("default", math.nan))
            # what is no number is among the problems
            table[column] = pd.to_numeric(cells, errors="coerce").astype(float)
    return table


@functools.cache
def _schema(name: str) -> dict[str, Any]:
    file = ROOT / f"workflow/schemas/{name}.schema.yaml"
    return yaml.safe_load(file.read_text(encoding="utf-8"))


def _read_lines(path: Path) -> tuple[list[str], str, list[tuple[int, list[str]]]]:
    """The column names, the separator, and the cells of each row by line number."""
    try:
        check_size(path, LARGEST_TABLE)
        mark = ""  # in a workbook, a number that was typed as text may have a decimal comma
        if path.suffix.lower() == ".xlsx":
            lines = _sheet(path)
        else:
            content = path.read_bytes()
            text = content.decode(encoding_of(content)).removeprefix("\ufeff")
            records, mark = records_of(text)
            lines = [(record.line, record.cells) for record in records]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        remedy = "Correct its path in the config, or save it as CSV in UTF-8."
        raise ConfigError(path, f"cannot be read ({error})", remedy) from error
    lines = [
        (n, cells) for n, cells in lines if any(cells) and not _is_comment(cells[0])
    ]
    count = len(lines) - 1
    if not 1 <= count <= _MOST_ROWS:
        raise ConfigError(
            path,
            f"the table has {count if count > 0 else 'no'} rows",
            f"Give a line of column names and at most {_MOST_ROWS} rows, a line each.",
        )
    header = lines[0][1]
    while not header[-1]:  # as long as the widest row
        header.pop()
    return header, mark, lines[1:]


def alike(column: str) -> str:
    """A column's name without its capitals, blanks and marks that nobody sees."""
    return unicodedata.normalize("NFKC", column).strip(" \ufeff\u200b").casefold()


def encoding_of(content: bytes) -> str:
    """UTF-16 by its mark, UTF-8, or code page 1252."""
    marks = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
    if content[:2] in marks:
        return marks[content[:2]]
    try:
        content.decode()
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def records_of(text: str) -> tuple[list[Record], str]:
    """The records of a table in text, and the separator of its cells.

    Raises a `csv.Error` if a quote is not closed, which would hide rows.
    """
    lines = [*io.StringIO(text, newline="")]
    # A spreadsheet puts a comment in quotes, and writes blank rows as rows of empty cells.
    full = (
        line for line in lines if line.strip(' \t\r\n,;"') and not _is_comment(line)
    )
    mark = separator_of(next(full, "")) or ","
    records: list[Record] = []
    rest, start = iter(lines), 0
    for line in rest:
        cells, end = [""], start + 1
        if line.strip() and not _is_comment(line):
            # takes as many lines as the row has
            reader = csv.reader(
                itertools.chain([line], rest), delimiter=mark, strict=True
            )
            cells = [cell.strip() for cell in next(reader)]
            end = start + reader.line_num
        records.append(Record("".join(lines[start:end]), cells, end))
        start = end
    return records, mark


def _sheet(path: Path) -> list[tuple[int, list[str]]]:
    """The cells of a workbook's first sheet by row, as text. Rows without cells are left out."""
    try:
        lines = [*_rows_in_sheet(path)]
    except (MemoryError, ConfigError):
        raise
    except Exception as error:  # openpyxl raises whatever its parsers raise
        reason = f"{type(error).__name__}: {error}"
        if isinstance(error, InputError):
            reason = error.problem
        problem = (
            f"cannot be read as a workbook ({plain_text(reason)}), or is too large"
        )
        remedy = "Delete rows and columns without values, or save it as CSV in UTF-8."
        raise ConfigError(path, problem, remedy) from error
    width = max((len(cells) for _, cells in lines), default=0)
    return [(n, cells + [""] * (width - len(cells))) for n, cells in lines]


def _rows_in_sheet(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Numbers and cells of rows that have any; a `ValueError` if these would fill the memory.

    Raises a `ConfigError` if the program that wrote a formula computed nothing: the cell is not
    empty to who opens the workbook.
    """
    letters = 0
    values, formulas = (_sheet_of(path, data_only=only) for only in (True, False))
    for number, row in enumerate(zip(values, formulas, strict=True), 1):
        for cell, formula in zip(*row, strict=True):
            is_empty = cell.value is None and formula.value is not None
            if is_empty and cell.data_type == "n":  # that of an empty text is another
                raise ConfigError(
                    f"{path}, cell {cell.coordinate}",
                    "its formula has no stored value",
                    "Open the workbook in a spreadsheet program, and save it there.",
                )
        cells = ["" if cell.value is None else str(cell.value) for cell in row[0]]
        if any(cells[_MOST_COLUMNS:]):
            raise ValueError(f"row {number} has cells beyond column {_MOST_COLUMNS}")
        letters += len(cells) + sum(map(len, cells))
        if letters > _MOST_LETTERS:
            raise ValueError(f"its cells are too long, or too many, at row {number}")
        if any(cells):
            yield number, [cell.strip() for cell in cells[:_MOST_COLUMNS]]


def _sheet_of(path: Path, *, data_only: bool) -> Iterator[Sequence[Any]]:
    """The rows of a workbook's first sheet, with stored values or with formulas."""
    import openpyxl

    book = openpyxl.load_workbook(
        plain_zip(path), read_only=True, data_only=data_only, keep_links=False
    )
    sheet = book.worksheets[0]
    sheet.reset_dimensions()  # which may be stated wrongly
    yield from sheet.iter_rows(max_row=_LAST_ROW)


def _is_comment(line: str) -> bool:
    """Whether a line, or its first cell, is a comment, and not the error of a formula."""
    start = line.lstrip(' "')
    return start.startswith("#") and not FORMULA_ERROR.match(start)


def _number(cell: str, mark: str) -> float | str:
    """The number in a cell; the cell itself if it is not a finite number."""
    text = cell if mark == "," else cell.replace(",", ".")
    value = float(text) if _NUMBER.fullmatch(text) else math.inf
    return value if math.isfinite(value) else cell


def _explain(error: ValidationError) -> str:
    """The problem with a cell."""
    # one that is absent is named by the message, and perhaps what asks for it
    if not error.absolute_path:
        name, *asking = error.message.split("'")[1::2]
        return f"{name} is empty" + (f", but {asking[0]} is given" if asking else "")
    name, cell, why = error.absolute_path[-1], error.instance, f": {error.message}"
    if error.validator == "type":
        whole = "whole " if error.validator_value == "integer" else ""
        return f"{name} is {cell!r}, not a {whole}number"
    if error.validator == "pattern":  # which is for the machine
        why = ""
        if name == "patch":
            why = f": write {re.sub('[^A-Za-z0-9]+', '-', cell).strip('-')}"
    return f"{name} is {cell!r}{why} [{error.schema['description']}]"
