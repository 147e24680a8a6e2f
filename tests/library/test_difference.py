"""`gst diff`: which tables, rows and columns changed, by how much, and what stands behind it."""

import json
import shutil

import pytest
from click.testing import CliRunner

from gstlib.cli import main
from gstlib.difference import compare_results
from gstlib.errors import InputError

TABLES = {
    "patches.csv": "patch,pressure_MPa,in_study\n5,47.104,yes\n8,40.2,yes\n10,0,no\n",
    "paths.csv": "patch,step,stiffness\n5,1,100.5\n5,2,200\n8,1,90\n",
}
PROVENANCE = {"config": {"hardness": 2000.0}, "software": {"gstlib": "0.1.0"}}


@pytest.fixture
def folders(tmp_path):
    one, other = tmp_path / "a", tmp_path / "b"
    (one / "tables").mkdir(parents=True)
    for name, text in TABLES.items():
        (one / "tables" / name).write_text(text)
    (one / "provenance.json").write_text(json.dumps(PROVENANCE))
    shutil.copytree(one, other)
    return one, other


def edit(folder, name, old, new):
    file = folder / name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_same_folders(folders):
    assert compare_results(*folders) == []
    assert run(*folders).exit_code == 0


def test_value_by_row_and_column(folders):
    edit(folders[1], "tables/paths.csv", "5,2,200", "5,2,201")
    (change,) = compare_results(*folders)
    assert (change.where, change.row, change.column) == (
        "paths.csv",
        "patch=5, step=2",
        "stiffness",
    )
    assert (change.before, change.after) == ("200", "201")
    assert change.relative == pytest.approx(1 / 201)


def test_tolerance(folders):
    edit(folders[1], "tables/paths.csv", "5,2,200", "5,2,200.1")
    assert len(compare_results(*folders, tolerance=1e-4)) == 1
    assert compare_results(*folders, tolerance=1e-3) == []


def test_zero_is_far_from_any_number(folders):
    edit(folders[1], "tables/patches.csv", "10,0,no", "10,1e-12,no")
    (change,) = compare_results(*folders, tolerance=0.5)
    assert change.relative == 1


def test_text_has_no_tolerance(folders):
    edit(folders[1], "tables/patches.csv", "40.2,yes", "40.2,no")
    (change,) = compare_results(*folders, tolerance=1.0)
    assert change.relative is None


def test_rows_columns_and_tables_on_one_side(folders):
    edit(folders[1], "tables/patches.csv", "8,40.2,yes\n", "")
    edit(folders[0], "tables/paths.csv", "stiffness", "hardness")
    (folders[0] / "tables/more.csv").write_text("a\n1\n")
    found = {
        (change.where, change.what, change.row, change.column)
        for change in compare_results(*folders)
    }
    assert ("patches.csv", "row", "patch=8", "") in found
    assert ("paths.csv", "column", "", "stiffness") in found
    assert ("paths.csv", "column", "", "hardness") in found
    assert ("more.csv", "table", "", "") in found


def test_order_of_rows_does_not_matter(folders):
    edit(
        folders[1], "tables/patches.csv", "5,47.104,yes\n8,40.2,yes\n", "8,40.2,yes\n5,47.104,yes\n"
    )
    assert compare_results(*folders) == []


def test_what_stands_behind_a_result(folders):
    edit(folders[1], "provenance.json", "2000.0", "1000.0")
    (change,) = compare_results(*folders)
    assert (change.where, change.what) == ("provenance", "config.hardness")
    result = run(*folders)
    assert result.exit_code == 0  # the results are the same
    assert "config.hardness: 2000.0 → 1000.0" in result.output


def run(*arguments):
    return CliRunner().invoke(main, ["diff", *map(str, arguments)])


def test_command_for_people_machines_and_scripts(folders):
    edit(folders[1], "tables/patches.csv", "47.104", "47.2")
    result = run(*folders)
    assert result.exit_code == 1
    assert "patches.csv: 1 change, by up to 0.002 of the value" in result.output
    assert "value patch=5, pressure_MPa: 47.104 → 47.2" in result.output
    (change,) = json.loads(run("--json", *folders).output)
    assert change["column"] == "pressure_MPa"


def test_no_results(folders, tmp_path):
    with pytest.raises(InputError, match="no tables"):
        compare_results(folders[0], tmp_path / "nowhere")
    result = run(folders[0], tmp_path / "nowhere")
    assert result.exit_code == 2
    assert "nowhere" in result.stderr
