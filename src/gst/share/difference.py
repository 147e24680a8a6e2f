"""What changed between two result folders: tables by row and column, and their provenance.

A row is identified by the key of its table, as the schema gives it (`gst.config.tables`). Tables
from another config may therefore have additional or missing rows; the rest is still compared. A
table that the schema does not list, or whose key does not tell its rows apart, is compared row by
row.
"""

import io
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gst.config.tables import TABLES
from gst.run.received import read_json, regular_file
from gstlib.errors import InputError
from gstlib.io.files import check_size

__all__ = ["compare_results", "describe_changes"]

_PROVENANCE = "provenance"


def compare_results(
    before: str | Path, after: str | Path, tolerance: float = 0.0
) -> pd.DataFrame:
    """Compare two result folders; numbers that differ by at most `tolerance` count as equal.

    The result has a row for each change: ``table`` (or "provenance"); ``row`` (as in
    ``patch=5, epoch=T0``), empty if one side has no such table; ``column``, empty if one side has
    no such row; ``before`` and ``after``, as written in the files, empty where absent;
    ``relative``, abs(after - before) over the larger magnitude, NaN for text. Raises an
    `InputError` if a folder has no tables, or a file in it cannot be read.
    """
    sides = [_read_tables(Path(folder)) for folder in (before, after)]
    changes: list[tuple[str, ...]] = []
    for name in sorted({*sides[0], *sides[1]}):
        tables = [side[name] for side in sides if name in side]
        if len(tables) == 2:
            changes += [(name, *change) for change in _changes(name, tables)]
        else:
            changes.append((name, "", "", *_where(name, sides)))
    columns = ["table", "row", "column", "before", "after"]
    found = pd.DataFrame(changes, columns=columns, dtype=str)
    old = pd.to_numeric(found.before, errors="coerce")
    new = pd.to_numeric(found.after, errors="coerce")
    largest = np.maximum(old.abs(), new.abs())
    relative = (new - old).abs() / largest.where(largest != 0, 1.0)
    found["relative"] = relative.where(np.isfinite(largest))
    return found[~(found.relative <= tolerance)].reset_index(drop=True)


def _where(name: str, sides: Iterable[Collection[str]]) -> list[str]:
    """On which sides there is something."""
    return ["present" if name in side else "" for side in sides]


def describe_changes(changes: pd.DataFrame, at_most: int = 20) -> str:
    """The changes for a reader: one line each, at most the `at_most` largest per table."""
    lines = []
    for table, found in changes.groupby("table", sort=False):
        plural = "s" if len(found) > 1 else ""
        lines.append(f"{table}: {len(found)} change{plural}")
        largest_first = found.sort_values("relative", ascending=False, na_position="first")
        lines += map(_described, largest_first.head(at_most).itertuples())
        if len(found) > at_most:
            lines.append(f"  ... and {len(found) - at_most} more")
    return "\n".join(lines)


def _described(change: Any) -> str:
    """One change in a line."""
    place = ", ".join(filter(None, [change.row, change.column]))
    old, new = change.before or "(none)", change.after or "(none)"
    by = "" if np.isnan(change.relative) else f"  ({change.relative:.2g})"
    return f"  {place}: {old} → {new}{by}"


def _read_tables(folder: Path) -> dict[str, pd.DataFrame]:
    """Every table, as text, and `provenance.json` as one, by name."""
    files = sorted((folder / "tables").glob("*.csv"))
    if not files:
        raise InputError(folder, "has no tables/*.csv", "Name the results folder of a study.")
    as_text = {"dtype": str, "keep_default_na": False}
    tables = {}
    try:
        for path in files:
            file = regular_file(path, folder)
            check_size(file)
            tables[path.name] = pd.read_csv(io.BytesIO(file.read_bytes()), **as_text)
    except ValueError as error:
        raise InputError(folder, f"cannot be read: {error}", "Run the study again.") from error
    record = folder / "provenance.json"
    if os.path.lexists(record):
        values = _values(read_json(record, folder, {"type": "object"}))
        tables[_PROVENANCE] = pd.DataFrame(values, columns=["key", "value"], dtype=str)
    return tables


def _values(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Every value in nested objects as text, by its keys."""
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _values(part, f"{key}.{name}" if key else name)
    else:
        yield key, str(value)


def _changes(name: str, sides: Sequence[pd.DataFrame]) -> list[tuple[str, ...]]:
    """Row, column, text before and text after of each cell that differs."""
    key = _key(name, sides)
    cells = [side.set_axis(_rows(side, key)).stack() for side in sides]
    rows = [{*side.index.get_level_values(0)} for side in cells]
    changes: list[tuple[str, ...]] = []
    for (row, column), old, new in pd.concat(cells, axis=1).fillna("").itertuples():
        where = _where(row, rows)
        if not all(where):
            changes.append((row, "", *where))
        elif old != new:
            changes.append((row, column, old, new))
    return list(dict.fromkeys(changes))


def _rows(table: pd.DataFrame, key: list[str]) -> list[str]:
    """A name for each row: what its key says, or its number."""
    if not key:
        return [f"row {number}" for number in range(1, len(table) + 1)]
    rows = []
    for row in table[key].to_dict("records"):
        rows.append(", ".join(f"{part}={value}" for part, value in row.items() if value))
    return rows


def _key(name: str, sides: Sequence[pd.DataFrame]) -> list[str]:
    """The columns that identify a row on every side; empty where none do."""
    listed = TABLES.get(Path(name).stem)
    key = listed.key if listed else []
    if name == _PROVENANCE:
        key = ["key"]
    for side in sides:
        if not {*key} <= {*side} or len({*_rows(side, key)}) < len(side):
            return []
    return key
