"""When a report is made anew, and the config to repeat a study."""

import json
import os
import sys
from pathlib import Path

import yaml
from click.testing import CliRunner

from gstlib.cli import main

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))
from build_report import is_report_current

RECORD = {
    "config": {"title": "a stone", "macroscale": {"grid": 100}},
    "software": {"gstlib": "0.1.0", "commit": "ef" * 20},
}


def test_a_report_is_made_anew_when_something_that_it_shows_is_younger(tmp_path):
    parts = [
        "provenance.json",
        "verdict.html",
        "tables/a.csv",
        "figures/patch/1.png",
        "logs/solve_patches.log",
    ]
    for name in ("report.html", *parts):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
        os.utime(file, (1e9, 1e9))
    assert is_report_current(tmp_path)
    for name in parts:
        os.utime(tmp_path / name, (1e9 + 1, 1e9 + 1))
        assert not is_report_current(tmp_path), name
        os.utime(tmp_path / name, (1e9, 1e9))
    (tmp_path / "report.html").unlink()
    assert not is_report_current(tmp_path)


def test_the_config_to_make_results_again(tmp_path):
    (tmp_path / "provenance.json").write_text(json.dumps(RECORD))
    said = CliRunner().invoke(main, ["config", str(tmp_path)])
    assert said.exit_code == 0
    assert said.output.startswith(f"# gstlib 0.1.0, commit {'ef' * 20}\n")
    assert yaml.safe_load(said.output) == RECORD["config"]
