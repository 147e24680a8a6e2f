"""What changed between two result folders: tables by rows and columns, and where results come from.

A row is known by its leading columns: the fewest that tell all rows of both tables apart. A table
from another config may thus have rows more or fewer, and the rest is still compared.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import pandas as pd

from gstlib.errors import InputError

__all__ = ["Change", "as_json", "compare_results", "describe_changes"]


@dataclass(frozen=True)
class Change:
    """One difference.

    Attributes
    ----------
    where : str
        Name of the table, or "provenance".
    what : str
        "table", "column", "row" (one side lacks it), "value", or a key of the provenance.
    row, column : str
        Which, as far as it applies: a row as ``patch=5, epoch=T0``.
    before, after : str
        As written in the files; empty where there is nothing.
    relative : float or None
        |after − before| over the larger of both, for numbers.
    """

    where: str
    what: str
    row: str = ""
    column: str = ""
    before: str = ""
    after: str = ""
    relative: float | None = None


def compare_results(before: str | Path, after: str | Path, tolerance: float = 0.0) -> list[Change]:
    """Compare two result folders.

    Parameters
    ----------
    before, after : path
        Folders of the config's key ``results``.
    tolerance : float
        Numbers whose relative difference is at most this are the same.

    Returns
    -------
    list of Change
        In the order of tables, rows and columns; empty if nothing changed.

    Raises
    ------
    InputError
        One of them has no tables.
    """
    folders = [Path(folder) for folder in (before, after)]
    tables = []
    for folder in folders:
        found = {file.name: file for file in (folder / "tables").glob("*.csv")}
        if not found:
            raise InputError(
                folder, "there are no tables/*.csv in it", "Name the results folder of a study."
            )
        tables.append(found)
    changes = list(_provenance_changes(*folders))
    for name in sorted({*tables[0], *tables[1]}):
        if name in tables[0] and name in tables[1]:
            changes += _table_changes(name, tables[0][name], tables[1][name], tolerance)
        else:
            present = ["there" if name in side else "" for side in tables]
            changes.append(Change(name, "table", before=present[0], after=present[1]))
    return changes


def describe_changes(changes: list[Change], at_most: int = 20) -> str:
    """The changes for a person: a line each, of each table the `at_most` largest."""
    lines = []
    for where in dict.fromkeys(change.where for change in changes):
        of_table = [change for change in changes if change.where == where]
        numbers = [change.relative for change in of_table if change.relative is not None]
        largest = f", by up to {max(numbers):.2g} of the value" if numbers else ""
        count = f"{len(of_table)} change{'s' if len(of_table) > 1 else ''}"
        lines.append(f"{where}: {count}{largest}")
        of_table.sort(
            key=lambda change: -(math.inf if change.relative is None else change.relative)
        )
        for change in of_table[:at_most]:
            place = ", ".join(part for part in (change.row, change.column) if part)
            what = f"{change.what} {place}" if place else change.what
            by = "" if change.relative is None else f"  ({change.relative:.2g})"
            sides = f"{change.before or '(none)'} → {change.after or '(none)'}"
            lines.append(f"  {what}: {sides}{by}")
        if len(of_table) > at_most:
            lines.append(f"  ... and {len(of_table) - at_most} more")
    return "\n".join(lines)


def as_json(changes: list[Change]) -> str:
    """The changes for a machine: a list of objects with the attributes of `Change`."""
    return json.dumps([asdict(change) for change in changes], ensure_ascii=False, indent=1)


def _read(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path, dtype=str, keep_default_na=False)
    except (OSError, ValueError) as error:
        raise InputError(
            path, f"cannot be read as a table ({error})", "Run the study again."
        ) from error


def _table_changes(name: str, before: Path, after: Path, tolerance: float) -> Iterator[Change]:
    if before.read_bytes() == after.read_bytes():
        return
    tables = [_read(before), _read(after)]
    columns = [list(table.columns) for table in tables]
    for column in dict.fromkeys(columns[0] + columns[1]):
        if column not in columns[0] or column not in columns[1]:
            present = ["there" if column in side else "" for side in columns]
            yield Change(name, "column", column=column, before=present[0], after=present[1])
    common = [column for column in columns[0] if column in columns[1]]
    key = _key(tables, common)
    rows = [{_row(record, key): record for record in table.to_dict("records")} for table in tables]
    for row in dict.fromkeys([*rows[0], *rows[1]]):
        if row not in rows[0] or row not in rows[1]:
            present = ["there" if row in side else "" for side in rows]
            yield Change(name, "row", row=row, before=present[0], after=present[1])
            continue
        for column in common:
            old, new = rows[0][row][column], rows[1][row][column]
            relative = _relative(old, new)
            if old != new and (relative is None or relative > tolerance):
                yield Change(name, "value", row, column, old, new, relative)


def _key(tables: list[pd.DataFrame], common: list[str]) -> list[str]:
    """The fewest leading columns that tell the rows of both tables apart."""
    for count in range(1, len(common) + 1):
        if not any(table.duplicated(common[:count]).any() for table in tables):
            return common[:count]
    return common


def _row(record: dict[str, str], key: list[str]) -> str:
    return ", ".join(f"{column}={record[column]}" for column in key if record[column])


def _relative(old: str, new: str) -> float | None:
    try:
        a, b = float(old), float(new)
    except ValueError:
        return None
    if not (math.isfinite(a) and math.isfinite(b)):
        return None
    return abs(b - a) / max(abs(a), abs(b)) if a != b else 0.0


def _provenance_changes(before: Path, after: Path) -> Iterator[Change]:
    """Differences of the two `provenance.json`, key by key."""
    sides = []
    for folder in (before, after):
        file = folder / "provenance.json"
        try:
            content = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
        except ValueError as error:
            raise InputError(
                file, f"cannot be read as JSON ({error})", "Run the study again."
            ) from error
        sides.append(dict(_leaves(content)))
    for key in dict.fromkeys([*sides[0], *sides[1]]):
        old, new = (side.get(key, "") for side in sides)
        if old != new:
            yield Change("provenance", key, before=old, after=new)


def _leaves(content: object, key: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(content, dict) and content:
        for name, value in content.items():
            yield from _leaves(value, f"{key}.{name}" if key else name)
    else:
        yield key, content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
