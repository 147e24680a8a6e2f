"""Names of an earlier version: refused where they would do harm, and mapped in old tables."""

import csv
import io
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from gst.config.reading import config_problems
from gst.config.renamed import COLUMNS, KEYS, VALUES
from gst.run.owned import refuse_foreign

ROOT = Path(__file__).parents[2]
BASELINE = ROOT / "tests/baseline/tables"


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


def older(name, text):
    """A table as the earlier version wrote it."""
    headings = {new: old for old, new in COLUMNS.get(name, {}).items()}
    header, *rows = csv.reader(io.StringIO(text))
    for column, values in VALUES.get(name, {}).items():
        former, place = {new: old for old, new in values.items()}, header.index(column)
        for row in rows:
            row[place] = former.get(row[place], row[place])
    if name == "validation_summary":
        place = header.index("statistic")
        header = [*header[: place + 1], *header[place + 3 :]]
        rows = [
            [*row[:place], _joined(*row[place : place + 3]), *row[place + 3 :]]
            for row in rows
        ]
    stream = io.StringIO()
    lines = [[headings.get(heading, heading) for heading in header], *rows]
    csv.writer(stream, lineterminator="\n").writerows(lines)
    return stream.getvalue()


def _joined(statistic, *arguments):
    named = ", ".join(filter(None, arguments))
    return f"{statistic}({named})" if named else statistic


def test_old_tables_are_copied_under_the_present_names(tmp_path):
    old = tmp_path / "tables"
    old.mkdir()
    for file in BASELINE.glob("*.csv"):
        (old / file.name).write_text(older(file.stem, file.read_text("utf-8")), "utf-8")
    assert "placed" in (old / "two_scales.csv").read_text("utf-8")
    command = [sys.executable, "workflow/rename_tables.py", old, tmp_path / "copies"]
    result = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert "use.csv: taken -> adopted\n" in result.stdout
    for file in BASELINE.glob("*.csv"):
        assert (tmp_path / "copies" / file.name).read_bytes() == file.read_bytes()
    again = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert again.returncode == 2


def test_results_of_the_earlier_version_are_refused_as_a_whole(tmp_path, capsys):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/place_patches.json").write_text("{}")
    with pytest.raises(SystemExit) as stopped:
        refuse_foreign([], tmp_path)
    assert stopped.value.code == 2
    assert "earlier version" in capsys.readouterr().err
