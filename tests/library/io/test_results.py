"""The list of tables: what it says of each, and whether the default study's are as listed."""

import re
from pathlib import Path

import pandas as pd
import pytest
from gstlib.io.results import TABLES, Column, columns_of
from gstlib.io.tables import write_table

BASELINE = Path(__file__).parents[2] / "baseline/tables"


def test_units_are_those_that_names_end_with():
    units = {
        "displacement_um": "µm",
        "stiffness_MPa_per_um": "MPa/µm",
        "Vvc_um3_per_um2": "µm³/µm²",
        "exposure_N_per_mm": "N/mm",
        "loss_volume_um3": "µm³",
        "force_N": "N",
        "n": "",
        "against": "",
    }
    assert {name: Column(name, "").unit for name in units} == units
    # of a unit that the list does not know, nothing would be said
    ends = r"_(?:[A-Za-z]*[mM]\d?|[GM]?Pa|N|deg|m?rad|percent)$"
    for listed in TABLES.values():
        for column in listed.columns:
            assert bool(column.unit) == bool(re.search(ends, column.name)), column.name


@pytest.mark.parametrize("name", TABLES)
def test_a_table_and_its_columns_are_explained_in_phrases(name):
    listed = TABLES[name]
    assert listed.caption.strip().endswith((".", "%}"))
    for text in (listed.title, *listed.meanings.values()):
        assert text
        assert not text.endswith(".")
    assert set(listed.optional) <= set(listed.meanings)
    for words in re.findall(r"``(\w+)\.csv``", listed.caption):
        assert words in TABLES


@pytest.mark.parametrize("file", sorted(BASELINE.glob("*.csv")), ids=lambda file: file.stem)
def test_the_default_study_has_the_columns_listed(file):
    found = file.read_text().splitlines()[0].split(",")
    absent = set(TABLES[file.stem].optional) - set(found)
    assert found == [name for name in columns_of(file.stem) if name not in absent]


def test_other_columns_are_refused(tmp_path):
    (tmp_path / "tables").mkdir()
    names = columns_of("patch_intervals")
    rows = pd.DataFrame([["5", *range(len(names) - 2), "mesh"]], columns=names)
    path = tmp_path / "tables/patch_intervals.csv"
    write_table(path, rows)
    write_table(path, rows[names[:4]])  # the others may be missing
    told = "patch_intervals.csv would have the columns .*; gstlib.io.results lists patch, press"
    for wrong in (rows[names[:3]], rows[names[::-1]], rows.assign(more=1)):
        with pytest.raises(ValueError, match=told):
            write_table(path, wrong)
        write_table(tmp_path / "patch_intervals.csv", wrong)  # no table of results
    assert path.read_text().startswith(f"{','.join(names[:4])}\n")


def test_a_stiffness_has_a_digit_less(tmp_path):
    columns = {name: [1.23456789] for name in columns_of("macroscale_path")}
    write_table(tmp_path / "t.csv", pd.DataFrame(columns))
    assert (tmp_path / "t.csv").read_text().splitlines()[1] == f"{5 * '1.2346,'}1.235"
