"""The schema of the tables agrees with itself, with what is written and with the baseline."""

import pandas as pd
import pytest

from gst.config.tables import TABLES, columns_of, write_table

# How the name of a column spells its unit.
SPELLED = {"/": "_per_", "µ": "u", "²": "2", "³": "3", "°": "deg", "%": "percent"}


def test_a_name_ends_with_its_unit():
    names = [pair for table in TABLES.values() for pair in table.columns.items()]
    units = {column.unit for _, column in names if column.unit}
    spelled = {
        unit: "".join(SPELLED.get(letter, letter) for letter in unit) for unit in units
    }
    for name, column in names:
        endings = [unit for unit in units if name.endswith(f"_{spelled[unit]}")]
        assert column.unit == max(endings, key=len, default=""), (
            name
        )  # MPa/µm ends with µm


def test_what_is_written_has_the_columns_and_digits_of_the_schema(tmp_path):
    names = columns_of("macroscale_path")
    rows = pd.DataFrame([[1, *[1.23456789] * 5]], columns=names)
    path = tmp_path / "macroscale_path.csv"
    for table, line in (
        (rows, ["1,1.2346,1.2346,1.2346,1.2346,1.235"]),
        (pd.DataFrame(), []),
    ):
        write_table(path, table)
        assert path.read_text().split() == [",".join(names), *line]
    for wrong in (rows[names[:3]], rows[names[::-1]], rows.assign(more=1)):
        with pytest.raises(ValueError, match=r"would have the columns .*lists"):
            write_table(path, wrong)
    names = columns_of("patch_intervals")[:4]  # the others may be missing
    rows = pd.DataFrame([["5", 0, 1, 2]], columns=names)
    write_table(tmp_path / "patch_intervals.csv", rows)
