"""Names of an earlier version: refused where they would do harm, and mapped in old tables."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gst.config.reading import config_problems
from gst.config.renamed import COLUMNS, KEYS, VALUES
from gst.config.tables import TABLES
from gst.run.owned import refuse_foreign

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"traces": {"minimum_points": 4}}, "traces is now detection"),
        (
            {"detection": {"minimum_points": 4}},
            "minimum_points is now minimum_cluster_points",
        ),
        (
            {"uncertainty": {"force_fraction": 0.3}},
            "force_fraction is now force_log_sd",
        ),
        ({"coupling": "placed"}, "placed is now equilibrium"),
    ],
)
def test_an_old_key_is_refused_with_the_new_one(old, new):
    config = yaml.safe_load((ROOT / "config/tiny.yaml").read_text()) | old
    assert new in "".join(config_problems(config))


def test_every_new_key_exists():
    text = (ROOT / "config/README.md").read_text("utf-8")
    assert all(f"{new}`" in text for new in KEYS.values())


OLD = {
    "use": "parameter,stated,taken\ngain,2.50,yes\n",
    "two_scales": "patch,variant\n1,placed\n1,highest_levelled\n",
    "validation_summary": (
        'statistic,value\nmean(mcc),0.870\n"spearman(loss, pressure)",1\nskill,0\n'
    ),
    "cases": "patch,case\n1,placed\n",
}
PRESENT = {
    "use": "parameter,prior,adopted\nlog_score_gain,2.50,yes\n",
    "two_scales": "patch,variant\n1,equilibrium\n1,highest_paper\n",
    "validation_summary": (
        "statistic,x,y,value\nmean,mcc,,0.870\nspearman,loss,pressure,1\nskill,,,0\n"
    ),
    "cases": OLD["cases"],
}


def test_old_tables_are_copied_under_the_present_names(tmp_path):
    old, copies = tmp_path / "tables", tmp_path / "copies"
    old.mkdir()
    for name, text in OLD.items():
        (old / f"{name}.csv").write_text(text)
    command = [sys.executable, "workflow/rename_tables.py", old, copies]
    result = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "use.csv: taken -> adopted\n" in result.stdout
    assert {file.stem: file.read_text() for file in copies.iterdir()} == PRESENT
    assert subprocess.run(command, cwd=ROOT, check=False).returncode == 2


def test_present_names_are_those_of_the_tables():
    for table, columns in COLUMNS.items():
        assert {*columns.values()} <= {*TABLES[table].columns}
    assert all(
        {*columns} <= {*TABLES[table].columns} for table, columns in VALUES.items()
    )


def test_results_of_the_earlier_version_are_refused_as_a_whole(tmp_path, capsys):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/place_patches.json").write_text("{}")
    with pytest.raises(SystemExit) as stopped:
        refuse_foreign([], tmp_path)
    assert stopped.value.code == 2
    assert "earlier version" in capsys.readouterr().err
