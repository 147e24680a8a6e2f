"""Changes between two result folders: tables by row and column, and their provenance.

A row is identified by the key of its table, as the schema gives it (`gst.config.tables`). Tables
from another config may therefore have additional or missing rows; the rest is still compared. A
table that the schema does not list, or whose key does not tell its rows apart, is compared row by
row.
"""

import io
import os
from pathlib import Path

import numpy as np
import pandas as pd

from gst.config.tables import TABLES
from gst.run.chain import made_in
from gst.run.received import AnyObject, read_json, regular_file
from gstlib.errors import InputError
from gstlib.io.files import check_size

_PROVENANCE = "provenance"
# The text of each cell by table, row and column; "present" for each row and each table as a whole.
_Cells = dict[tuple[str, str, str], str]


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
    old, new = _cells_of(Path(before)), _cells_of(Path(after))
    changes = []
    for table, row, column in dict.fromkeys([*old, *new]):
        wholes = [(table, "", "")] * (row != "") + [(table, row, "")] * (column != "")
        if all(whole in old and whole in new for whole in wholes):
            texts = [side.get((table, row, column), "") for side in (old, new)]
            if texts[0] != texts[1]:
                changes.append((table, row, column, *texts))
    changes.sort(key=lambda change: change[0])
    columns = ["table", "row", "column", "before", "after"]
    differences = pd.DataFrame(changes, columns=columns, dtype=str)
    earlier = pd.to_numeric(differences.before, errors="coerce")
    later = pd.to_numeric(differences.after, errors="coerce")
    largest = np.maximum(earlier.abs(), later.abs())
    relative = (later - earlier).abs() / largest.where(largest != 0, 1.0)
    differences["relative"] = relative.where(np.isfinite(largest))
    return differences[~(differences.relative <= tolerance)].reset_index(drop=True)


def describe_changes(changes: pd.DataFrame, at_most: int = 20) -> str:
    """The changes for a reader: one line each, at most the `at_most` largest per table."""
    lines = []
    for table, group in changes.groupby("table", sort=False):
        plural = "s" if len(group) > 1 else ""
        lines.append(f"{table}: {len(group)} change{plural}")
        largest_first = group.sort_values(
            "relative", ascending=False, na_position="first"
        )
        for change in largest_first.head(at_most).itertuples():
            place = ", ".join(filter(None, [change.row, change.column]))
            by = "" if np.isnan(change.relative) else f"  ({change.relative:.2g})"
            texts = f"{change.before or '(none)'} → {change.after or '(none)'}"
            lines.append(f"  {place}: {texts}{by}")
        if len(group) > at_most:
            lines.append(f"  ... and {len(group) - at_most} more")
    return "\n".join(lines)


def _cells_of(folder: Path) -> _Cells:
    """Every cell of the study's tables, and every value of its `provenance.json`.

    A folder without the record of a page has the tables that are there.
    """
    files = sorted((folder / "tables").glob("*.csv"))
    if made := {*made_in(folder)}:  # other configs may have left others
        files = [file for file in files if file in made]
    if not files:
        raise InputError(
            folder, "has no tables/*.csv", "Name the results folder of a study."
        )
    cells: _Cells = {}
    try:
        for path in files:
            file = regular_file(path, folder)
            check_size(file)
            text = io.BytesIO(file.read_bytes())
            cells |= _cells(
                path.name, pd.read_csv(text, dtype=str, keep_default_na=False)
            )
    except ValueError as error:
        raise InputError(
            folder, f"cannot be read: {error}", "Run the study again."
        ) from error
    record = folder / "provenance.json"
    if os.path.lexists(record):
        flat = pd.json_normalize(read_json(record, folder, AnyObject)).map(str).T
        table = flat.rename_axis("key").set_axis(["value"], axis=1).reset_index()
        cells |= _cells(_PROVENANCE, table)
    return cells


def _cells(name: str, table: pd.DataFrame) -> _Cells:
    """The cells of a table; a row is called after its key, or by its number."""
    listed = TABLES.get(Path(name).stem)
    key = ["key"] if name == _PROVENANCE else listed.key if listed else []
    if not {*key} <= {*table} or table.duplicated(key or None).any():
        key = []
    cells = {(name, "", ""): "present"}
    for number, record in enumerate(table.to_dict("records"), start=1):
        row = ", ".join(f"{part}={record[part]}" for part in key if record[part])
        row = row or f"row {number}"
        cells[name, row, ""] = "present"
        cells |= {(name, row, str(column)): text for column, text in record.items()}
    return cells
