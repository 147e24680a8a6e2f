"""The default study's tables are those in the repository, digit by digit.

A change of theirs is meant or is a mistake. Meant: `make baseline` renews them, and the commit
shows which numbers moved.
"""

from pathlib import Path

from conftest import fresh

from gstlib.difference import compare_results, describe_changes

BASELINE = Path(__file__).parents[1] / "baseline"


def test_default_study_gives_the_baseline(tmp_path):
    study = fresh(tmp_path / "study")
    study.config = "config/config.yaml"
    tables = sorted(file.name for file in BASELINE.glob("tables/*.csv"))
    assert len(tables) > 15
    result = study.run(*(f"results/tables/{name}" for name in tables))
    assert result.returncode == 0, result.stderr
    changes = [c for c in compare_results(BASELINE, study.results) if c.where != "provenance"]
    assert not changes, describe_changes(changes)
