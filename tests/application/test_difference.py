"""`gst diff`: which tables, rows and columns changed, by how much, and from which settings."""

import pytest
from folders import fill
from shell import command

from gst.run.chain import PAGE, Step, given_to, write_record
from gst.share.difference import compare_results, describe_changes

FILES = {
    "tables/patch_pressures.csv": "patch,pressure_MPa,in_study\n"
    "5,47.104,yes\n8,40.2,yes\n10,0,no\n",
    "tables/microscale_paths.csv": "patch,step,stiffness\n5,1,100.5\n5,2,200\n8,1,90\n",
    "provenance.json": '{"config": {"pressure_cap_MPa": 2000.0, "use": null},'
    ' "software": {"gstlib": "0.1.0"}}',
}


@pytest.fixture
def folders(tmp_path):
    one, other = tmp_path / "a", tmp_path / "b"
    for folder in (one, other):
        fill(folder, FILES)
    return one, other


def edit(folder, name, old, new):
    file = folder / name
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_value_by_row_and_column(folders):
    assert compare_results(*folders).empty
    edit(folders[1], "tables/microscale_paths.csv", "5,2,200", "5,2,200.1")
    (change,) = compare_results(*folders, tolerance=1e-4).itertuples(index=False)
    assert change[:5] == (
        "microscale_paths.csv",
        "patch=5, step=2",
        "stiffness",
        "200",
        "200.1",
    )
    assert change.relative == pytest.approx(0.1 / 200.1)
    assert compare_results(*folders, tolerance=1e-3).empty


@pytest.mark.parametrize(
    ("old", "new", "count"),
    [
        ("10,0,no", "10,1e-12,no", 1),  # zero is far from any number
        ("10,0,no", "10,,no", 1),
        ("8,40.2,yes", "8,40.2,no", 1),  # text
        ("10,0,no", "10,0.0,no", 0),  # the same number
        (
            "5,47.104,yes\n8,40.2,yes\n",
            "8,40.2,yes\n5,47.104,yes\n",
            0,
        ),  # in another order
    ],
)
def test_no_tolerance_for_zero_and_what_is_no_number(folders, old, new, count):
    edit(folders[1], "tables/patch_pressures.csv", old, new)
    assert len(compare_results(*folders, tolerance=0.9)) == count


def test_rows_columns_and_tables_on_one_side(folders):
    one, other = folders
    edit(other, "tables/patch_pressures.csv", "8,40.2,yes\n", "")
    edit(one, "tables/microscale_paths.csv", "stiffness", "pressure_cap_MPa")
    (one / "tables/more.csv").write_text("a\n1\n")
    text = describe_changes(compare_results(one, other), at_most=1)
    assert text.splitlines() == [
        "microscale_paths.csv: 6 changes",
        "  patch=5, step=1, pressure_cap_MPa: 100.5 → (none)",
        "  ... and 5 more",
        "more.csv: 1 change",
        "  : present → (none)",
        "patch_pressures.csv: 1 change",
        "  patch=8: present → (none)",
    ]


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("wear.csv", ["patch=5, model=archard", "patch=5, model=none"]),
        (
            "patch_pressures.csv",
            ["row 1", "row 2"],
        ),  # its key does not tell these rows apart
        ("another.csv", ["row 1", "row 2"]),
    ],
)
def test_rows_are_told_apart_by_the_key_of_the_schema(folders, name, rows):
    for value, folder in enumerate(folders):
        text = f"patch,model,mcc\n5,archard,{value}\n5,none,{value}\n"
        (folder / "tables" / name).write_text(text)
    assert compare_results(*folders).row.tolist() == rows


def test_a_table_that_another_config_left_is_not_compared(folders):
    for folder in folders:
        page = folder / "index.html"
        tables = [*folder.glob("tables/*")]
        made = {"couple_scales": ""}
        steps = (
            Step("couple_scales", {}, [], tables),
            Step(PAGE, {"steps": made}, tables, [page]),
        )
        (folder / "logs").mkdir()
        page.touch()
        for step in steps:
            write_record(folder, step, given_to(folder, step), {})
    (folders[0] / "tables/use.csv").write_text("parameter,prior\nradius,200\n")
    assert compare_results(*folders).empty


def test_command_and_its_exit_codes(folders):
    one, other = folders
    edit(other, "provenance.json", "2000.0", "1000.0")
    result = command("diff", one, other)
    assert result.exit_code == 0  # the results are the same
    change = "  key=config.pressure_cap_MPa, value: 2000.0 → 1000.0  (0.5)"
    assert result.output.splitlines() == ["provenance: 1 change", change]
    edit(other, "tables/patch_pressures.csv", "40.2", "50.2")
    result = command("diff", one, other)
    assert result.exit_code == 1
    assert "  patch=8, pressure_MPa: 40.2 → 50.2  (0.2)\n" in result.output
    (other / "provenance.json").write_text("[1, 2]")
    result = command("diff", one, other)
    assert result.exit_code == 2
    assert f"ERROR: {other / 'provenance.json'}: " in result.stderr
    (other / "tables/patch_pressures.csv").write_text("")
    assert f"ERROR: {other}: cannot be read" in command("diff", one, other).stderr
