"""Copy tables that an earlier version made under the present headings and values.

    python workflow/rename_tables.py old/results/tables renamed

The numbers stay as they are, digit by digit, so that `gst diff` can compare the copies with the
tables of a new run. Each renamed heading and value is printed.
"""

import argparse
from pathlib import Path

import pandas as pd

from gst.config.renamed import COLUMNS, VALUES

STATISTIC = r"(?P<statistic>[^(]+)(?:\((?P<x>[^,]+)(?:, (?P<y>.+))?\))?$"


def renamed(name: str, table: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """A table under the present names, and a line for each name that changed."""
    columns = COLUMNS.get(name, {})
    changes = [f"{old} -> {columns[old]}" for old in table if old in columns]
    table = table.rename(columns=columns)
    for column, values in VALUES.get(name, {}).items():
        present = sorted({*table[column]} & {*values})
        changes += [f"{column}: {value} -> {values[value]}" for value in present]
        table[column] = table[column].replace(values)
    if name == "validation_summary" and "x" not in table:
        # three columns in place of a statistic such as ``spearman(x, y)``
        parts = table["statistic"].str.extract(STATISTIC).fillna("")
        place = table.columns.get_loc("statistic")
        around = table.iloc[:, :place], table.iloc[:, place + 1 :]
        table = pd.concat([around[0], parts, around[1]], axis=1)
        changes.append("statistic -> statistic, x, y")
    return table, changes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", type=Path, help="folder with the old tables")
    parser.add_argument("copies", type=Path, help="new folder for the renamed copies")
    arguments = parser.parse_args()
    files = sorted(arguments.tables.glob("*.csv"))
    if not files:
        parser.error(f"{arguments.tables} does not contain a table (*.csv)")
    if arguments.copies.exists():
        parser.error(f"{arguments.copies} exists: name a new folder")
    arguments.copies.mkdir(parents=True)
    for file in files:
        old = pd.read_csv(file, dtype=str, keep_default_na=False)
        table, changes = renamed(file.stem, old)
        table.to_csv(arguments.copies / file.name, index=False, lineterminator="\n")
        for change in changes:
            print(f"{file.name}: {change}")


if __name__ == "__main__":
    main()
