"""Names of an earlier version: refused where they would do harm, and mapped in old tables."""

import subprocess
import sys

import pytest
import yaml
from folders import fill

from gst import ROOT
from gst.config.reading import config_problems
from gst.config.renamed import COLUMNS, KEYS, VALUES
from gst.config.tables import TABLES
from gst.run.owned import refuse_foreign


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("traces: {minimum_points: 4}", "traces is now detection"),
        (
            "detection: {minimum_points: 4}",
            "minimum_points is now minimum_cluster_points",
        ),
        ("uncertainty: {force_fraction: 0.3}", "force_fraction is now force_log_sd"),
        ("coupling: placed", "placed is now equilibrium"),
    ],
)
def test_an_old_key_is_refused_with_the_new_one(old, new):
    config = (ROOT / "config/tiny.yaml").read_text() + old
    assert new in "".join(config_problems(yaml.safe_load(config)))


def test_every_new_key_exists():
    text = (ROOT / "config/README.md").read_text("utf-8")
    assert all(f"{new}`" in text for new in KEYS.values())


OLD = {
    "use.csv": "parameter,stated,taken\ngain,2.50,yes\n",
    "two_scales.csv": "patch,variant\n1,placed\n1,highest_levelled\n",
    "validation_summary.csv": (
        'statistic,value\nmean(mcc),0.870\n"spearman(loss, pressure)",1\nskill,0\n'
    ),
    "cases.csv": "patch,case\n1,placed\n",
}
PRESENT = {
    "use.csv": "parameter,prior,adopted\nlog_score_gain,2.50,yes\n",
    "two_scales.csv": "patch,variant\n1,equilibrium\n1,highest_paper\n",
    "validation_summary.csv": (
        "statistic,x,y,value\nmean,mcc,,0.870\nspearman,loss,pressure,1\nskill,,,0\n"
    ),
    "cases.csv": OLD["cases.csv"],
}


def test_old_tables_are_copied_under_the_present_names(tmp_path):
    old, copies = tmp_path / "tables", tmp_path / "copies"
    fill(old, OLD)
    command = [sys.executable, "workflow/rename_tables.py", old, copies]
    said = subprocess.check_output(command, cwd=ROOT, text=True)
    assert "use.csv: taken -> adopted\n" in said
    assert {file.name: file.read_text() for file in copies.iterdir()} == PRESENT
    assert subprocess.call(command, cwd=ROOT) == 2


def test_present_names_are_those_of_the_tables():
    for table, columns in COLUMNS.items():
        assert {*columns.values()} <= {*TABLES[table].columns}
    assert all(
        {*columns} <= {*TABLES[table].columns} for table, columns in VALUES.items()
    )


def test_results_of_the_earlier_version_are_refused_as_a_whole(tmp_path, capsys):
    fill(tmp_path, {"logs/place_patches.json": "{}"})
    with pytest.raises(SystemExit) as stopped:
        refuse_foreign([], tmp_path)
    assert stopped.value.code == 2
    assert "earlier version" in capsys.readouterr().err
