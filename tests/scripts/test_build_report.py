"""The report's own script: when it builds the report anew."""

import importlib.util
import os
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "workflow/build_report.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("build_report", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def report(tmp_path):
    """A report, a second younger than all that it shows."""
    shown = ["provenance.json", "tables/inputs.csv", "figures/inputs.png", "figures/patch/7.png"]
    for age, name in [*((2, name) for name in shown), (1, "report.html")]:
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
        os.utime(file, (1e9 - age, 1e9 - age))
    return tmp_path / "report.html"


def test_a_report_is_not_built_twice(script, report):
    assert script.is_up_to_date(report)
    report.unlink()
    assert not script.is_up_to_date(report)


@pytest.mark.parametrize(
    "name",
    ["tables/inputs.csv", "figures/patch/7.png", "provenance.json"],
    ids=["table", "figure", "title or other settings"],
)
def test_a_report_is_built_anew_after_a_change(script, report, name):
    os.utime(report.parent / name, (1e9, 1e9))
    assert not script.is_up_to_date(report)
