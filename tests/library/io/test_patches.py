"""The patch table: everything wrong with it is said at once, with line numbers."""

from pathlib import Path

import numpy as np
import pytest

from gstlib.errors import ConfigError
from gstlib.io.patches import read_patches, readable_patches

ROOT = Path(__file__).parents[3]
SCHEMA = ROOT / "workflow" / "schemas" / "patches.schema.yaml"


def read(path, size_mm=5.0, patch_size_mm=0.85):
    return read_patches(path, schema=SCHEMA, size_mm=size_mm, patch_size_mm=patch_size_mm)


@pytest.fixture
def table(tmp_path):
    def write(text, name="patches.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def refused(path, *parts):
    with pytest.raises(ConfigError) as caught:
        read(path)
    message = str(caught.value)
    assert path.name in message
    for part in parts:
        assert part in message
    return message


@pytest.mark.parametrize(("name", "separator"), [("p.csv", ","), ("p.tsv", "\t")])
def test_rows_in_natural_order_with_every_column(table, name, separator):
    text = (
        "# a comment\npatch,x_mm,y_mm,t0,t1\n10,1,2,a.plu,b.plu\n\n"
        "# another, with, commas\n2,2.5,0.5,c.plu,\nA,1,1,d.plu,\n"
    )
    patches = read(table(text.replace(",", separator), name))
    assert list(patches.patch) == ["2", "10", "A"]
    assert list(patches.t1) == ["", "b.plu", ""]
    assert list(patches.x_mm) == [2.5, 1.0, 1.0]
    assert (patches.rotation_deg == 0).all()
    assert np.isnan(patches.crop_x_mm).all()
    assert (patches.note == "").all()


@pytest.mark.parametrize("name", ["p.csv", "p.tsv", "p.txt"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), ("\t", ","), (";", ".")])
def test_tables_as_spreadsheets_write_them(tmp_path, name, encoding, separator, point):
    rows = [
        ["# moulds"],
        [],
        ["patch", "x_mm", "y_mm", "t0", "note"],
        ["5", f"4{point}5", f"0{point}5", "5.plu", "Höhe"],
        [],
        ["7", "1", f"1{point}25", "7.plu"],
    ]
    text = "".join(separator.join(row + [""] * (7 - len(row))) + "\r\n" for row in rows)
    (tmp_path / name).write_bytes(text.encode(encoding))
    patches = read(tmp_path / name)
    assert list(patches.patch) == ["5", "7"]
    assert list(patches.x_mm) == [4.5, 1.0]
    assert list(patches.y_mm) == [0.5, 1.25]
    assert list(patches.note) == ["Höhe", ""]


def test_spreadsheet_tables_keep_their_line_numbers(table):
    text = (
        '"# a comment; quoted";;;;\n;;;;\npatch;x_mm;y_mm;t0;\n1;0,5;1;a;\n;;;;\n'
        "2;1.234,5;1;b;\n3;1;1;c;seen\n"
    )
    refused(
        table(text),
        "line 6 (patch 2): x_mm is '1.234,5', not a number",
        "line 7: 5 cells in 4 columns",
        "2 problems",
    )
    # between commas a comma is no decimal sign
    refused(table('patch,x_mm,y_mm,t0\n1,"0,5",1,a\n'), "x_mm is '0,5', not a number")


def test_ids_stay_text(table):
    patches = read(table("patch,x_mm,y_mm,t0\n01,1,1,a\n1,2,2,b\n"))
    assert sorted(patches.patch) == ["01", "1"]


def test_all_problems_at_once(table):
    message = refused(
        table(
            "patch,x_mm,y_mm,t0,rotation_deg,crop_x_mm,crop_y_mm\n"
            "1,1,1,a,,,\n"
            "1,2,2,b,,,\n"
            "a/b,2,2,c,,,\n"
            "3,two,2,d,,,\n"
            "4,4.9,0.4,e,,,\n"
            "5,,2,,,,\n"
            "6,1,1,f,,0.5,\n"
            "7,1,1,g,400,,\n"
            "8,nan,1,h,,,\n"
            "9,1,1,i,,,,extra\n"
        ),
        "line 3 (patch 1): same id as in line 2",
        "line 4 (patch a/b): patch is 'a/b'",
        "line 5 (patch 3): x_mm is 'two', not a number",
        "line 6 (patch 4): its footprint of 0.85 mm sticks out of the 5 mm square by "
        "0.325 mm at the x = 5 side and 0.025 mm at the y = 0 side",
        "line 7 (patch 5): lacks x_mm, t0",
        "line 8 (patch 6): crop_x_mm and crop_y_mm go together",
        "line 9 (patch 7): rotation_deg is 400",
        "line 10 (patch 8): x_mm is 'nan', not a number",
        "line 11: 8 cells in 7 columns",
        "9 problems",
    )
    assert "line 2 " not in message


def test_ids_that_differ_in_case_only_would_share_files(table):
    refused(table("patch,x_mm,y_mm,t0\na,1,1,f\nA,2,2,g\n"), "same id as in line 2")


def test_turned_footprint_needs_more_room(table):
    text = "patch,x_mm,y_mm,t0,rotation_deg\n1,0.45,1,a,{}\n"
    read(table(text.format(0)))
    read(table(text.format(90)))
    refused(table(text.format(45)), "0.151 mm at the x = 0 side")


def test_footprint_may_touch_the_edge(table):
    read(table("patch,x_mm,y_mm,t0\n1,0.425,4.575,a\n"))


@pytest.mark.parametrize(
    ("header", "part"),
    [
        ("patch,x_mm,t0", "missing columns ['y_mm']"),
        ("patch,x_mm,y_mm,t0,pressure", "unknown columns ['pressure']"),
        ("patch,x_mm,y_mm,t0,t0", "repeated columns ['t0']"),
        ("patch,x_mm,y_mm,,t0", "unknown columns ['']"),
        ("patch x_mm y_mm t0", "separated by tabs, commas or semicolons"),
    ],
)
def test_columns(table, header, part):
    refused(table(f"{header}\n1,1,1,1,1\n"), part)


def test_files_that_are_no_table(table, tmp_path):
    refused(tmp_path / "none.tsv", "no such file")
    refused(table("", "empty.tsv"), "no rows")
    refused(table("patch,x_mm,y_mm,t0\n", "header.csv"), "no rows")
    refused(table("x", "table.xlsx"), "'.xlsx'")
    (tmp_path / "latin.csv").write_bytes("patch,x_mm,y_mm,t0,note\n1,1,1,a,Höhe".encode("latin-1"))
    refused(tmp_path / "latin.csv", "not UTF-8")
    refused(table(",,,\n,,,\n", "commas.csv"), "no rows")


def test_shipped_tables():
    for path in sorted((ROOT / "config").glob("patches*.tsv")):
        assert len(read(path)) > 0


def test_rows_that_name_their_scans_are_had_from_a_faulty_table(table):
    path = table(
        "patch,x_mm,y_mm,t0,t1,crop_x_mm,crop_y_mm\n"
        "5,49,1,a,b,,\n"  # out of the square
        "7,1;5,1,c,,0.1,0.2\n"  # no number
        "7,1,1,d,,,\n"  # again
        "8_,1,1,e,,,\n"  # no id
        "9,1,1,f,,0.1,\n"  # half a crop: which piece is not known
        "10,1,1,,,,\n"  # no scan
    )
    refused(path, "line 2", "line 3", "line 4", "line 5", "line 6", "line 7")
    rows = readable_patches(path, schema=SCHEMA)
    assert list(rows.patch) == ["5", "7", "8_"]
    assert list(rows.t0 + rows.t1) == ["ab", "c", "e"]
    np.testing.assert_array_equal(rows.x_mm, [49.0, np.nan, 1.0])
    np.testing.assert_array_equal(rows.crop_x_mm, [np.nan, 0.1, np.nan])


def test_a_table_that_cannot_be_read_has_no_rows(table):
    for path in (table("patch,x,y\n1,2,3\n"), Path("none.csv")):
        assert len(readable_patches(path, schema=SCHEMA)) == 0
