"""`gst diff`: which tables, rows and columns changed, by how much, and from which settings."""

import json
import shutil

import pytest
from click.testing import CliRunner
from gst.cli import main
from gst.share.difference import compare_results, describe_changes

TABLES = {
    "patch_pressures.csv": "patch,pressure_MPa,in_study\n5,47.104,yes\n8,40.2,yes\n10,0,no\n",
    "microscale_paths.csv": "patch,step,stiffness\n5,1,100.5\n5,2,200\n8,1,90\n",
}
PROVENANCE = {
    "config": {"pressure_cap_MPa": 2000.0, "published": None},
    "software": {"gstlib": "0.1.0"},
}


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


def run(*arguments):
    return CliRunner().invoke(main, ["diff", *map(str, arguments)])


def test_value_by_row_and_column(folders):
    assert compare_results(*folders).empty
    edit(folders[1], "tables/microscale_paths.csv", "5,2,200", "5,2,200.1")
    (change,) = compare_results(*folders, tolerance=1e-4).itertuples(index=False)
    assert change[:5] == ("microscale_paths.csv", "patch=5, step=2", "stiffness", "200", "200.1")
    assert change.relative == pytest.approx(0.1 / 200.1)
    assert compare_results(*folders, tolerance=1e-3).empty


@pytest.mark.parametrize(
    ("old", "new", "relative"),
    [
        ("10,0,no", "10,1e-12,no", [1.0]),  # zero is far from any number
        ("10,0,no", "10,inf,no", [None]),
        ("10,0,no", "10,,no", [None]),
        ("8,40.2,yes", "8,40.2,no", [None]),  # text
        ("10,0,no", "10,0.0,no", []),  # the same number
        ("5,47.104,yes\n8,40.2,yes\n", "8,40.2,yes\n5,47.104,yes\n", []),  # rows in another order
    ],
)
def test_no_tolerance_for_zero_and_what_is_no_number(folders, old, new, relative):
    edit(folders[1], "tables/patch_pressures.csv", old, new)
    found = compare_results(*folders, tolerance=0.9).relative
    assert [None if value != value else value for value in found] == relative


def test_rows_columns_and_tables_on_one_side(folders):
    edit(folders[1], "tables/patch_pressures.csv", "8,40.2,yes\n", "")
    edit(folders[0], "tables/microscale_paths.csv", "stiffness", "pressure_cap_MPa")
    (folders[0] / "tables/more.csv").write_text("a\n1\n")
    found = compare_results(*folders)
    changes = list(found.drop(columns="relative").itertuples(index=False, name=None))
    assert len(changes) == 1 + 1 + 2 * 3
    for change in [
        ("more.csv", "", "", "present", ""),
        ("patch_pressures.csv", "patch=8", "", "present", ""),
        ("microscale_paths.csv", "patch=5, step=1", "pressure_cap_MPa", "100.5", ""),
        ("microscale_paths.csv", "patch=5, step=1", "stiffness", "", "100.5"),
    ]:
        assert change in changes
    assert "  patch=8: present → (none)" in describe_changes(found)


def test_the_largest_changes_are_shown_first(folders):
    edit(folders[1], "tables/microscale_paths.csv", "5,1,100.5", "5,1,100.6")
    edit(folders[1], "tables/microscale_paths.csv", "8,1,90", "8,1,900")
    _, first, more = describe_changes(compare_results(*folders), at_most=1).splitlines()
    assert first == "  patch=8, step=1, stiffness: 90 → 900  (0.9)"
    assert more == "  ... and 1 more"


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("wear.csv", [f"patch=5, model={model}" for model in ("archard", "none")]),
        ("patch_pressures.csv", ["row 1", "row 2"]),  # its key does not tell these rows apart
        ("gridding.csv", ["row 1", "row 2"]),  # its key is not there
        ("another.csv", ["row 1", "row 2"]),
    ],
)
def test_rows_are_told_apart_by_the_key_of_the_schema(folders, name, rows):
    for folder, value in zip(folders, (1, 2), strict=True):
        lines = ["patch,model,mcc", f"5,archard,{value}", f"5,none,{value}"]
        (folder / "tables" / name).write_text("\n".join(lines))
    changes = compare_results(*folders)
    assert changes.row.tolist() == rows
    assert set(changes.column) == {"mcc"}


def test_command_and_its_exit_codes(folders, tmp_path):
    edit(folders[1], "provenance.json", "2000.0", "1000.0")
    result = run(*folders)
    assert result.exit_code == 0  # the results are the same
    change = "  key=config.pressure_cap_MPa, value: 2000.0 → 1000.0  (0.5)"
    assert result.output.splitlines() == ["provenance: 1 change", change]
    assert run(folders[0], folders[0]).output.startswith("No difference between ")
    edit(folders[1], "tables/patch_pressures.csv", "40.2", "50.2")
    result = run(*folders)
    assert result.exit_code == 1
    assert (
        "patch_pressures.csv: 1 change\n  patch=8, pressure_MPa: 40.2 → 50.2  (0.2)\n"
        in result.output
    )
    assert result.output.splitlines()[-1].endswith("(exit code 1): patch_pressures.csv")
    (folders[1] / "provenance.json").write_text("[1, 2]")
    result = run(*folders)
    assert result.exit_code == 2
    assert f"ERROR: {folders[1] / 'provenance.json'}: " in result.stderr
    (folders[1] / "tables/patch_pressures.csv").write_text("")
    for folder, problem in ((tmp_path / "no", "has no tables"), (folders[1], "cannot be read")):
        result = run(folders[0], folder)
        assert result.exit_code == 2
        assert f"ERROR: {folder}: {problem}" in result.stderr
