"""The schema of the tables agrees with itself, with what is written and with the baseline."""

from pathlib import Path

import pandas as pd
import pytest
from gst.config.tables import TABLES, columns_of, write_table
from gstlib.io.tables import printed

ROOT = Path(__file__).parents[2]
BASELINE = sorted((ROOT / "tests/baseline/tables").glob("*.csv"))
# How the name of a column spells its unit.
SPELLED = {"/": "_per_", "µ": "u", "²": "2", "³": "3", "°": "deg", "%": "percent"}


def test_a_name_ends_with_its_unit():
    columns = [of for table in TABLES.values() for of in table.columns.items()]
    units = {
        said.unit: "".join(SPELLED.get(letter, letter) for letter in said.unit)
        for _, said in columns
        if said.unit
    }
    for name, said in columns:
        endings = [unit for unit, spelled in units.items() if name.endswith(f"_{spelled}")]
        assert said.unit == max(endings, key=len, default=""), name  # MPa/µm ends with µm


def test_a_table_has_a_stage_and_a_key_and_a_file_of_its_name():
    for name, table in TABLES.items():
        assert (ROOT / "src/gstlib" / table.stage).is_dir()
        assert set(table.key) <= set(table.columns)
        assert table.file.endswith(f"/{name}.csv")
    assert len({table.file for table in TABLES.values()}) == len(TABLES)


@pytest.mark.parametrize("file", BASELINE, ids=lambda file: file.stem)
def test_the_baseline_fits_the_schema(file):
    rows = pd.read_csv(file, dtype=str, keep_default_na=False)
    columns = TABLES[file.stem].columns
    assert list(rows) == [name for name, of in columns.items() if name in rows or not of.optional]
    assert not rows.duplicated(TABLES[file.stem].key).any()
    for name in rows:
        numbers = pd.to_numeric(rows[name], errors="coerce").dropna()
        for index, number in numbers.items():
            assert printed(number, columns[name].digits) == rows[name][index], name


def test_what_is_written_has_the_columns_and_digits_of_the_schema(tmp_path):
    names = columns_of("patch_intervals")
    rows = pd.DataFrame([["5", *range(len(names) - 2), "mesh"]], columns=names)
    path = tmp_path / "patch_intervals.csv"
    write_table(path, rows)
    write_table(path, rows[names[:4]])  # the others may be missing
    assert path.read_text() == f"{','.join(names[:4])}\n5,0,1,2\n"
    for wrong in (rows[names[:3]], rows[names[::-1]], rows.assign(more=1)):
        with pytest.raises(
            ValueError, match=r"patch_intervals\.csv would have the columns .*lists"
        ):
            write_table(path, wrong)
    write_table(path, pd.DataFrame())
    assert path.read_text() == f"{','.join(names[:4])}\n"
    path = tmp_path / "macroscale_path.csv"
    numbers = [1, *[1.23456789] * 5]
    write_table(path, pd.DataFrame([numbers], columns=columns_of("macroscale_path")))
    assert path.read_text().split()[1] == "1,1.2346,1.2346,1.2346,1.2346,1.235"
