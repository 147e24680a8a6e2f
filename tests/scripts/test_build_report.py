"""When a report is made anew."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "workflow"))
from build_report import is_report_current


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
