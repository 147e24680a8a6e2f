"""The list of tables: what it says of columns, and that others are refused."""

import pandas as pd
import pytest
from gstlib.io.results import Column, columns_of
from gstlib.io.tables import write_table


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
