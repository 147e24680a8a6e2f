"""Copy tables that an earlier version made under the present headings and values.

    python workflow/rename_tables.py old/results/tables renamed

The numbers stay as they are, digit by digit, so that `gst diff` can compare the copies with the
tables of a new run. Each renamed heading and value is printed.
"""

import argparse
import csv
import re
import sys
from pathlib import Path

from gst.config.renamed import COLUMNS, VALUES


def renamed(name: str, rows: list[list[str]]) -> tuple[list[list[str]], list[str]]:
    """The rows of a table under the present names, and a line for each name that changed."""
    columns = COLUMNS.get(name, {})
    header = [columns.get(column, column) for column in rows[0]]
    changes = [
        f"{old} -> {new}"
        for old, new in zip(rows[0], header, strict=True)
        if old != new
    ]
    for column, values in VALUES.get(name, {}).items():
        place = header.index(column)
        present = sorted({row[place] for row in rows[1:]} & {*values})
        changes += [f"{column}: {value} -> {values[value]}" for value in present]
        for row in rows[1:]:
            row[place] = values.get(row[place], row[place])
    rows = [header, *rows[1:]]
    if name == "validation_summary" and "x" not in header:
        rows = _separated(rows)
        changes.append("statistic -> statistic, x, y")
    return rows, changes


def _separated(rows: list[list[str]]) -> list[list[str]]:
    """The rows with three cells in place of a statistic such as ``spearman(x, y)``."""
    place = rows[0].index("statistic")
    separated = [[*rows[0][: place + 1], "x", "y", *rows[0][place + 1 :]]]
    for row in rows[1:]:
        name, x, y = re.fullmatch(
            r"([^(]+)(?:\(([^,]+)(?:, (.+))?\))?", row[place]
        ).groups("")
        separated.append([*row[:place], name, x, y, *row[place + 1 :]])
    return separated


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", type=Path, help="folder with the old tables")
    parser.add_argument("copies", type=Path, help="new folder for the renamed copies")
    arguments = parser.parse_args()
    files = sorted(arguments.tables.glob("*.csv"))
    if not files:
        print(
            f"ERROR: {arguments.tables} does not contain a table (*.csv)",
            file=sys.stderr,
        )
        return 2
    if arguments.copies.exists():
        print(f"ERROR: {arguments.copies} exists: name a new folder", file=sys.stderr)
        return 2
    arguments.copies.mkdir(parents=True)
    for file in files:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = [*csv.reader(stream)]
        rows, changes = renamed(file.stem, rows) if rows else (rows, [])
        with (arguments.copies / file.name).open(
            "w", newline="", encoding="utf-8"
        ) as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows)
        for change in changes:
            print(f"{file.name}: {change}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
