"""What changed between two result folders: tables by row and column, and their provenance.

A row is identified by the key of its table, as the schema gives it (`gst.tables`). Tables from
another config may therefore have additional or missing rows; the rest is still compared. A table
that the schema does not list, or whose key does not tell its rows apart, is compared row by row.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from gst.tables import TABLES
from gstlib.errors import InputError

__all__ = ["compare_results", "describe_changes"]

_PROVENANCE = "provenance"


def compare_results(
    before: str | Path, after: str | Path, tolerance: float = 0.0
) -> pd.DataFrame:
    """Compare two result folders.

    Parameters
    ----------
    before, after : path
        Folders of the config's key ``results``.
    tolerance : float
        Numbers whose relative difference is at most this count as equal.

    Returns
    -------
    pandas.DataFrame
        One line per change: ``table`` (or "provenance"); ``row`` (as in ``patch=5, epoch=T0``),
        empty if one side has no such table; ``column``, empty if one side has no such row;
        ``before`` and ``after``, as written in the files, empty where absent; ``relative``,
        abs(after - before) over the larger magnitude, NaN for text.

    Raises
    ------
    InputError
        A folder has no tables, or a file in it cannot be read.
    """
    old, new = (_read_tables(Path(folder)) for folder in (before, after))
    changes: list[tuple] = []
    for name in sorted({*old, *new}):
        if name in old and name in new:
            changes += [(name, *change) for change in _changes(name, old[name], new[name])]
        else:
            there = ("present" if name in side else "" for side in (old, new))
            changes.append((name, "", "", *there))
    found = pd.DataFrame(
        changes, columns=["table", "row", "column", "before", "after"], dtype=str
    )
    numbers = found[["before", "after"]].apply(pd.to_numeric, errors="coerce")
    numbers = numbers.astype(float).replace([np.inf, -np.inf], np.nan)
    largest = numbers.abs().max(axis=1, skipna=False)
    found["relative"] = (numbers.after - numbers.before).abs() / largest.where(
        largest != 0, 1.0
    )
    return found[~(found.relative <= tolerance)].reset_index(drop=True)


def describe_changes(changes: pd.DataFrame, at_most: int = 20) -> str:
    """The changes for a reader: one line each, at most the `at_most` largest per table."""
    lines = []
    for table, found in changes.groupby("table", sort=False):
        lines.append(f"{table}: {len(found)} change{'s' if len(found) > 1 else ''}")
        largest_first = found.sort_values("relative", ascending=False, na_position="first")
        for change in largest_first.head(at_most).itertuples():
            place = ", ".join(filter(None, [change.row, change.column]))
            by = "" if np.isnan(change.relative) else f"  ({change.relative:.2g})"
            lines.append(
                f"  {place}: {change.before or '(none)'} → {change.after or '(none)'}{by}"
            )
        lines += [f"  ... and {len(found) - at_most} more"] if len(found) > at_most else []
    return "\n".join(lines)


def _read_tables(folder: Path) -> dict[str, pd.DataFrame]:
    """Every table, as text, and `provenance.json` as one, by name."""
    files = sorted((folder / "tables").glob("*.csv"))
    if not files:
        raise InputError(folder, "has no tables/*.csv", "Name the results folder of a study.")
    record = folder / "provenance.json"
    try:
        tables = {
            file.name: pd.read_csv(file, dtype=str, keep_default_na=False) for file in files
        }
        content = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else {}
    except ValueError as error:
        raise InputError(folder, f"cannot be read: {error}", "Run the study again.") from error
    if content:
        values = pd.json_normalize(content).iloc[0].map(str).items()
        tables[_PROVENANCE] = pd.DataFrame(values, columns=["key", "value"])
    return tables


def _changes(
    name: str, old: pd.DataFrame, new: pd.DataFrame
) -> list[tuple[str, str, str, str]]:
    """Row, column, text before and text after of each cell that differs."""
    key = _key(name, old, new)
    cells = []
    for table in (old, new):
        rows = [f"row {number}" for number in range(1, len(table) + 1)]
        if key:
            rows = []
            for row in table.to_dict("records"):
                rows.append(", ".join(f"{part}={row[part]}" for part in key if row[part]))
        cells.append(table.set_axis(rows).stack())
    both = pd.concat(cells, axis=1).fillna("")
    sides = [set(of.index.get_level_values(0)) for of in cells]
    changes: dict[tuple[str, str, str, str], None] = {}
    for (row, column), before, after in both.itertuples():
        there = [row in side for side in sides]
        if not all(there):
            changes[row, "", *("present" if side else "" for side in there)] = None
        elif before != after:
            changes[row, column, before, after] = None
    return list(changes)


def _key(name: str, *sides: pd.DataFrame) -> list[str]:
    """The columns that identify a row on every side; empty where none do."""
    listed = TABLES.get(Path(name).stem)
    key = ["key"] if name == _PROVENANCE else listed.key if listed else []
    if all(set(key) <= set(side) and not side[key].duplicated().any() for side in sides):
        return key
    return []
