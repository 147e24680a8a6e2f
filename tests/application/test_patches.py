"""The patch table: everything wrong with it is said at once, with line numbers."""

import unicodedata
from pathlib import Path

import numpy as np
import pytest
from gst.patches import overlaps, read_patches, scan_files
from gstlib.errors import ConfigError
from gstlib.io.tables import read_table, write_table

ROOT = Path(__file__).parents[2]


def read(path, size_mm=5.0, patch_size_mm=0.85, **options):
    return read_patches(path, size_mm=size_mm, patch_size_mm=patch_size_mm, **options)


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


def test_names_that_look_like_something_else_stay_names(table, tmp_path):
    """As an empty cell, a number, or yes and no."""
    for names in (["007", "1e5", "7", "N-A", "NA", "None", "inf", "nan", "null"], ["no"]):
        rows = [f"{name},{1 + 0.9 * (i % 4)},{1 + i // 4}" for i, name in enumerate(names)]
        patches = read(table("patch,x_mm,y_mm,t0\n" + "".join(f"{row},a\n" for row in rows)))
        assert sorted(patches.patch) == names
        write_table(tmp_path / "t.csv", patches)
        again = read_table(tmp_path / "t.csv")
        assert list(again.patch) == list(patches.patch)
        assert again.crop_x_mm.isna().all()


@pytest.mark.parametrize(("in_table", "on_disk"), [("NFC", "NFD"), ("NFD", "NFC"), ("NFC", "NFC")])
def test_scans_are_found_however_their_accents_are_composed(table, tmp_path, in_table, on_disk):
    written = unicodedata.normalize(in_table, "alt/Höhe_é.plu")
    (tmp_path / "alt").mkdir()
    file = tmp_path / unicodedata.normalize(on_disk, "alt/Höhe_é.plu")
    file.touch()
    path = table(f"patch,x_mm,y_mm,t0,t1\n1,1,1,{written},gone.plu\n2,3,1,b/gone.plu,\n")
    patches = read(path, scan_folder=tmp_path)
    assert (tmp_path / patches.t0[0]).samefile(file)
    assert [patches.t1[0], patches.t0[1], patches.t1[1]] == ["gone.plu", "b/gone.plu", ""]


@pytest.mark.parametrize("name", ["/data/1.plu", "~/1.plu", r"C:\data\1.plu", r"\\server\1.plu"])
def test_scans_lie_in_the_scan_folder(table, name):
    message = refused(table(f"patch,x_mm,y_mm,t0,t1\n1,1,1,{name},a\n2,3,1,a,{name}\n"))
    assert f"line 2 (patch 1): t0 is {name!r} [" in message
    assert f"line 3 (patch 2): t1 is {name!r} [" in message
    read(table("patch,x_mm,y_mm,t0\n1,1,1,T0/1.plu\n"))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), ("\t", ","), (";", ".")])
def test_tables_as_spreadsheets_write_them(tmp_path, encoding, separator, point):
    rows = [
        ["# moulds"],
        [],
        ["patch", "x_mm", "y_mm", "t0", "note"],
        ["07", "1", f"1{point}25", "7.plu"],
        ["10", "2", "1", "10.plu"],
        [],
        ["5", f"4{point}5", f"0{point}5", "5.plu", "Höhe"],
    ]
    text = "".join(separator.join(row + [""] * (7 - len(row))) + "\r\n" for row in rows)
    (tmp_path / "p.csv").write_bytes(text.encode(encoding))
    patches = read(tmp_path / "p.csv")
    assert list(patches.patch) == ["5", "07", "10"]  # as text, in natural order
    assert list(patches.x_mm) == [4.5, 1.0, 2.0]
    assert list(patches.y_mm) == [0.5, 1.25, 1.0]
    assert list(patches.note) == ["Höhe", "", ""]
    assert (patches.rotation_deg == 0).all()
    assert np.isnan(patches.crop_x_mm).all()


def test_spreadsheet_tables_keep_their_line_numbers(table):
    text = (
        '"# a comment; quoted";;;;\n;;;;\npatch;x_mm;y_mm;t0;\n1;0,5;1;a;\n;;;;\n'
        "2;1.234,5;1;b;\n3;1;1;c;seen\n"
    )
    refused(
        table(text),
        "line 6 (patch 2): x_mm is '1.234,5', not a number",
        "line 7 (patch 3): 5 cells in 4 columns",
        "2 problems",
    )


@pytest.mark.parametrize("row", ['{},"0,5","1,5",a', "{},0,5,1,5,a"])
def test_decimal_commas_between_commas_are_one_problem(table, row):
    rows = "".join(row.format(patch) + "\n" for patch in range(14))
    message = refused(table(f"patch,x_mm,y_mm,t0\n{rows}"), "decimal commas, as in line 2")
    assert len(message.splitlines()) == 1
    refused(table("patch,x_mm,y_mm,t0\n1,1,1,a,b,c\n"), "6 cells in 4 columns")


def test_a_scan_after_use_needs_one_before(table):
    refused(table("patch,x_mm,y_mm,t0,t1\n1,1,1,,a\n"), "t0 is empty, but t1 is given")
    repeated = "patch,x_mm,y_mm,t0,repeat\n1,1,1,,a\n"
    refused(table(repeated), "t0 is empty, but repeat is given")


def test_a_repeat_is_a_scan_of_the_same_piece(table, tmp_path):
    (tmp_path / "b.plu").touch()
    path = table(
        "patch,x_mm,y_mm,t0,t1,repeat,crop_x_mm,crop_y_mm\n"
        "1,1,1,a.plu,,b.plu,0.2,-0.1\n2,3,1,c.plu,d.plu,,,\n"
    )
    patches = read(path, scan_folder=tmp_path)
    assert patches["repeat"].tolist() == ["b.plu", ""]
    first, again, *others = scan_files(patches, tmp_path, None)
    assert again == first._replace(path=tmp_path / "b.plu", epoch="repeat")
    assert [scan.epoch for scan in others] == ["T0", "T1"]
    refused(
        table("patch,x_mm,y_mm,t0,repeat\n1,1,1,a,/b.plu\n"),
        "line 2 (patch 1): repeat is '/b.plu' [",
    )
    assert read(table("patch,x_mm,y_mm,t0\n1,1,1,a\n"))["repeat"].tolist() == [""]


def test_all_problems_at_once(table):
    message = refused(
        table(
            "patch,x_mm,y_mm,t0,rotation_deg,crop_x_mm,crop_y_mm\n"
            "p1,1,1,a,,,\n"
            "P1,2,2,b,,,\n"  # some file systems ignore the case
            "a/b,3,2,c,,,\n"
            "all,3,1,c,,,\n"  # which tables call all patches together
            "3,two,2,d,,,\n"
            "4,4.9,0.4,e,,,\n"
            "5,,2,,,,\n"
            "6,1,3,f,,0.5,\n"
            "7,2,3,g,400,,\n"
            "8,nan,1,h,,,\n"
            "9,3,3,i,,,,extra\n"
        ),
        "line 3 (patch P1): same id as in line 2",
        "line 4 (patch a/b): patch is 'a/b'",
        "line 5 (patch all): patch is 'all'",
        "line 6 (patch 3): x_mm is 'two', not a number",
        "line 7 (patch 4): its footprint of 0.85 mm sticks out of the 5 mm square by "
        "0.325 mm at the x = 5 side and 0.025 mm at the y = 0 side",
        "line 8 (patch 5): x_mm is empty",
        "line 8 (patch 5): t0 is empty",
        "line 9 (patch 6): crop_y_mm is empty, but crop_x_mm is given",
        "line 10 (patch 7): rotation_deg is 400",
        "line 11 (patch 8): x_mm is 'nan', not a number",
        "line 12 (patch 9): 8 cells in 7 columns",
        "11 problems",
    )
    assert "line 2 " not in message


def test_a_place_scanned_twice_is_refused_and_a_small_overlap_is_not(table):
    near = "patch,x_mm,y_mm,t0\n1,1,1,a\n2,1.7,1,b\n3,1.4,1,c\n"
    refused(
        table(near),
        "line 4 (patch 3): its centre is 0.3 mm from that of line 3 (patch 2)",
        "1 problem ",
    )
    assert len(read(table(near.replace("3,1.4", "3,2.2")))) == 3


def test_patches_that_overlap_are_named_and_neighbours_are_not(table):
    text = (
        "patch,x_mm,y_mm,t0,rotation_deg\n1,1,1,a,0\n2,1.8,1,b,0\n3,2.65,1,c,0\n4,2.65,1.9,d,45\n"
    )
    near, turned = overlaps(read(table(text)), 0.85)
    assert near == ("1", "2", pytest.approx(0.05 / 0.85))
    assert turned[:2] == ("3", "4")


def test_turned_footprint_needs_more_room(table):
    read(table("patch,x_mm,y_mm,t0\n1,0.425,4.575,a\n"))  # it may touch the edge
    text = "patch,x_mm,y_mm,t0,rotation_deg\n1,0.45,1,a,{}\n"
    read(table(text.format(0)))
    read(table(text.format(90)))
    refused(table(text.format(45)), "0.151 mm at the x = 0 side")


@pytest.mark.parametrize(
    ("header", "part"),
    [
        ("patch,x_mm,t0", "missing columns ['y_mm']"),
        ("patch,x_mm,y_mm,t0,pressure", "unknown columns ['pressure']"),
        ("Patch,X_mm,y_mm,t0", "Write patch for Patch, x_mm for X_mm"),
        ("patch,x_mm,y_mm,,t0", "unknown columns ['']"),
        ("patch x_mm y_mm t0", "separated by tabs, commas or semicolons"),
    ],
)
def test_columns(table, header, part):
    refused(table(f"{header}\n1,1,1,1,1\n"), part)


def test_files_that_are_no_table(table, tmp_path):
    refused(tmp_path / "none.tsv", "No such file")
    refused(table("", "empty.tsv"), "no rows")
    refused(table("patch,x_mm,y_mm,t0\n", "header.csv"), "no rows")
    for start in (b"PK\x03\x04\x14\0", b"\xd0\xcf\x11\xe0\xa1\xb1"):
        (tmp_path / "sheet.tsv").write_bytes(start + bytes(range(256)))
        refused(tmp_path / "sheet.tsv", "is a spreadsheet", "CSV")
    (tmp_path / "latin.csv").write_bytes("patch,x_mm,y_mm,t0,note\n1,1,1,a,Höhe".encode("latin-1"))
    refused(tmp_path / "latin.csv", "save it as UTF-8")
    refused(table(",,,\n,,,\n", "commas.csv"), "no rows")


PROPOSED = """place,kind,x_mm,y_mm,exposure_N_per_mm,touched
E1,exposed,1.55,2.1,14742,1
C1,control,4.1,1.5,0,0
"""


def test_proposed_places_are_a_patch_table_as_they_stand(table, tmp_path):
    """Scans are named after their place, whatever their format; without T1 there is none."""
    path = table(PROPOSED, "places.csv")
    for name in ("E1_T0.plux", "e1_t1.sur", "C1_T0.plux", "E1_T0_notes"):
        (tmp_path / name).touch()
    patches = read(path, scan_folder=tmp_path)
    assert patches.patch.tolist() == ["C1", "E1"]
    assert patches.t0.tolist() == ["C1_T0.plux", "E1_T0.plux"]
    assert patches.t1.tolist() == ["", "e1_t1.sur"]
    assert patches["repeat"].tolist() == ["", ""]
    assert patches.x_mm.tolist() == [4.1, 1.55]
    generated = read(path)
    assert generated.t1.tolist() == ["C1_T1.plu", "E1_T1.plu"]
    assert generated["repeat"].tolist() == ["", ""]
    (tmp_path / "C1_repeat.plux").touch()
    assert read(path, scan_folder=tmp_path)["repeat"].tolist() == ["C1_repeat.plux", ""]


def test_a_place_without_its_scan_or_with_two_is_told(table, tmp_path):
    path = table(PROPOSED, "places.csv")
    for name in ("E1_T0.plux", "E1_T0.sur"):
        (tmp_path / name).touch()
    with pytest.raises(ConfigError) as caught:
        read(path, scan_folder=tmp_path)
    message = str(caught.value)
    assert f"line 2 (patch E1): E1_T0.plux, E1_T0.sur in {tmp_path} is named E1_T0" in message
    assert f"line 3 (patch C1): no file in {tmp_path} is named C1_T0" in message
    assert "add the columns t0 and t1" in message


CONFOMAP = "*_{patch}_*_0strokes.mnt,*_{patch}_*_2000strokes.mnt"


def test_a_name_with_a_star_is_that_of_the_file_that_fits(table, tmp_path):
    path = table(f"patch,x_mm,y_mm,t0,t1\nloc1,1,1,{CONFOMAP}\nloc10,3,1,b/{{patch}}_*,\n")
    for strokes in (0, 50, 2000):
        (tmp_path / f"A1_LSM_dorsal_loc1_shift-extract_{strokes}strokes.mnt").touch()
    (tmp_path / "A1_LSM_dorsal_loc10_shift-extract_0strokes.mnt").touch()
    (tmp_path / "b").mkdir()
    (tmp_path / "b/Loc10_T0.sur").touch()
    patches = read(path, scan_folder=tmp_path)
    assert patches.t0.tolist() == [
        "A1_LSM_dorsal_loc1_shift-extract_0strokes.mnt",
        "b/Loc10_T0.sur",
    ]
    assert patches.t1.tolist() == ["A1_LSM_dorsal_loc1_shift-extract_2000strokes.mnt", ""]


def test_a_name_with_a_star_that_fits_no_file_or_two_is_told(table, tmp_path):
    path = table("patch,x_mm,y_mm,t0\na,1,1,{patch}_*\nb,3,1,*{patch}_9.sur\n")
    for name in ("a_0.sur", "a_1.sur"):
        (tmp_path / name).touch()
    with pytest.raises(ConfigError) as caught:
        read(path, scan_folder=tmp_path)
    message = str(caught.value)
    two = f"'{{patch}}_*', and a_0.sur and a_1.sur in {tmp_path} fit a_*"
    assert f"line 2 (patch a): t0 is {two}: let it fit one file" in message
    none = f"'*{{patch}}_9.sur', and no file in {tmp_path} fits *b_9.sur"
    assert f"line 3 (patch b): t0 is {none}: let it fit one file" in message


def test_places_take_columns_of_files_and_no_others(table):
    wide = PROPOSED.replace("touched\n", "touched,t0,t1\n")
    wide = wide.replace(",1\n", ",1,a.plu,b.plu\n").replace(",0\n", ",0,c.plu,\n")
    patches = read(table(wide, "places.csv"))
    assert patches.t0.tolist() == ["c.plu", "a.plu"]
    assert patches.t1.tolist() == ["", "b.plu"]
    refused(table("patch,kind,x_mm,y_mm,t0\n1,a,1,1,b\n"), "unknown columns ['kind']")
