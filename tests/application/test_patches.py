"""The patch table: everything wrong with it is said at once, with line numbers."""

import unicodedata

import numpy as np
import openpyxl
import pytest
from gst.config.patches import overlaps, read_patches, scan_files
from gstlib.errors import ConfigError
from gstlib.io.tables import read_table, write_table

HEAD = "patch,x_mm,y_mm,t0"


def read(path, **options):
    return read_patches(path, size_mm=5.0, patch_size_mm=0.85, **options)


@pytest.fixture
def table(tmp_path):
    def write(text):
        path = tmp_path / "patches.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refused(path, *parts, **options):
    with pytest.raises(ConfigError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert [part for part in (path.name, *parts) if part not in message] == []
    return message


def test_names_that_look_like_something_else_stay_names(table, tmp_path):
    """As an empty cell, a number, or yes and no."""
    names = ["007", "1e5", "7", "N-A", "NA", "None", "inf", "nan", "no", "null"]
    rows = [f"{name},{1 + 0.9 * (i % 4)},{1 + i // 4},a\n" for i, name in enumerate(names)]
    patches = read(table(f"{HEAD}\n{''.join(rows)}"))
    assert sorted(patches.patch) == names
    write_table(tmp_path / "t.csv", patches)
    again = read_table(tmp_path / "t.csv")
    assert list(again.patch) == list(patches.patch)
    assert again.crop_x_mm.isna().all()


@pytest.mark.parametrize(("in_table", "on_disk"), [("NFC", "NFD"), ("NFD", "NFC")])
def test_scans_are_found_however_their_accents_are_composed(table, tmp_path, in_table, on_disk):
    written = unicodedata.normalize(in_table, "alt/Höhe_é.plu")
    file = tmp_path / unicodedata.normalize(on_disk, "alt/Höhe_é.plu")
    file.parent.mkdir()
    file.touch()
    path = table(f"{HEAD},t1\n1,1,1,{written},gone.plu\n2,3,1,b/gone.plu,\n")
    patches = read(path, scan_folder=tmp_path)
    assert (tmp_path / patches.t0[0]).samefile(file)
    assert [patches.t1[0], patches.t0[1], patches.t1[1]] == ["gone.plu", "b/gone.plu", ""]


@pytest.mark.parametrize(
    ("encoding", "separator", "point"),
    [
        ("utf-8", ",", "."),
        ("utf-8-sig", ";", ","),
        ("utf-16", "\t", ","),
        ("cp1252", ";", "."),
        ("utf-8-sig", ",", "."),
    ],
)
def test_tables_as_spreadsheets_write_them(table, encoding, separator, point):
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
    patches = read(table(text.encode(encoding)))
    assert list(patches.patch) == ["5", "07", "10"]  # as text, in natural order
    assert list(patches.x_mm) == [4.5, 1.0, 2.0]
    assert list(patches.note) == ["Höhe", "", ""]


def test_a_table_in_a_workbook(tmp_path):
    path, book = tmp_path / "p.xlsx", openpyxl.Workbook()
    for row in (["# moulds"], [], HEAD.split(","), ["07", 1, 1.25, "Höhe.plu"]):
        book.active.append(row)
    book.active.append([5, "4,5", 0.5, "5.plu"])
    book.active = book.create_sheet("notes")  # was open when it was saved
    book.save(path)
    patches = read(path)
    assert list(patches.patch) == ["5", "07"]
    assert list(patches.x_mm) == [4.5, 1.0]
    assert list(patches.t0) == ["5.plu", "Höhe.plu"]
    assert (patches.rotation_deg == 0).all()
    assert np.isnan(patches.crop_x_mm).all()
    book.worksheets[0]["B5"] = "far"
    book.save(path)
    refused(path, "line 5 (patch 5)")
    path.write_bytes(b"PK")
    refused(path, "save it as CSV")


def test_a_repeat_is_a_scan_of_the_same_piece(table, tmp_path):
    head = f"{HEAD},t1,repeat,crop_x_mm,crop_y_mm"
    path = table(f"{head}\n1,1,1,a.plu,,b.plu,0.2,-0.1\n2,3,1,c.plu,d.plu,,,\n")
    patches = read(path, scan_folder=tmp_path)
    first, again, *others = scan_files(patches, tmp_path, None)
    assert again == first._replace(path=tmp_path / "b.plu", epoch="repeat")
    assert [scan.epoch for scan in others] == ["T0", "T1"]
    assert [scan.crop for scan in (first, *others)] == [(-0.1, 0.2), None, None]  # y, x


def test_all_problems_at_once(table):
    message = refused(
        table(
            f"{HEAD},rotation_deg,crop_x_mm,crop_y_mm\n"
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
        "line 6 (patch 3): x_mm is 'two'",
        "line 7 (patch 4): its footprint",
        "0.325 mm at the x = 5 side and 0.025 mm at the y = 0 side",
        "line 8 (patch 5): x_mm is empty",
        "line 8 (patch 5): t0 is empty",
        "line 9 (patch 6): crop_y_mm is empty",
        "line 10 (patch 7): rotation_deg is 400",
        "line 11 (patch 8): x_mm is 'nan'",
        "line 12 (patch 9): 8 cells in 7 columns",
        "11 problems",
    )
    assert "line 2 " not in message


NO_NUMBERS = ["inf", "nan", "1_5", "1e", "0x10", "1d0", "١.٥", "１.５", "−1", "1mm", "#DIV/0!"]
REFUSED = [
    ("patch,x_mm,t0\n1,1,1\n", "y_mm"),
    (f"{HEAD},pressure\n1,1,1,1,1\n", "pressure"),
    ("patch x_mm y_mm t0\n1 1 1 1\n", "tabs, commas or semicolons"),
    ("", "no rows"),
    (f"{HEAD}\n", "no rows"),
    (",,,\n,,,\n", "no rows"),
    (b"PK\x03\x04\x14\0" + bytes(range(256)), "save it as CSV"),
    (f"{HEAD}\nloc 1_a,1,1,a\n", "write loc-1-a"),
    (f"{HEAD},t1\n1,1,1,,a\n", "t0 is empty"),
    (f"{HEAD},repeat\n1,1,1,,a\n", "t0 is empty"),
    (f"{HEAD},wear_grade\n1,1,1,a,2\n", "wear_grade stands beside scans"),
    (f"{HEAD},x_mm\n1,1,1,a,2\n", "line 1: a column is given twice"),
    (f"# mine\n{HEAD}, X_MM\n1,1,1,a,2\n", "line 2: a column is given twice"),
    (f"{HEAD},\ufeffｘ_mm\n1,1,1,a,2\n", "a column is given twice"),
    (f"{HEAD},note,Note\n1,1,1,a,2,3\n", "'note' and as 'Note'"),
    (f"{HEAD},t1\n1,1,1,a\n", "line 2 (patch 1): 4 cells in 5 columns"),
    (f'{HEAD},note\n1,1,1,a,"\n2,3,1,b,\n', "cannot be read"),
    ("patch;x_mm;y_mm;t0\n1;1.500;0;a\n2;1;2,5;b\n", "line 2 (patch 1): x_mm is '1.500'"),
    (f"{HEAD}\n#N/A,1,1,a\n2,3,1,b\n", "line 2 (patch #N/A): patch is"),
    (f'{HEAD}\n1,"0,5","1,5",a\n', "line 2 (patch 1): x_mm is '0,5'"),
    (f"{HEAD}\n1,0,5,1,5,a\n", "use semicolons or tabs"),
    # of a spreadsheet, comments and blank rows count as lines
    (
        '"# a; b";;;\n;;;\npatch;x_mm;y_mm;t0\n2;1.234,5;1;b\n',
        "line 4 (patch 2): x_mm is '1.234,5'",
    ),
    (f"{HEAD},rotation_deg\n1,0.45,1,a,45\n", "0.151 mm at the x = 0 side"),
]
REFUSED += [
    (f"{HEAD}\n1,{cell},1,a\n", f"line 2 (patch 1): x_mm is '{cell}'") for cell in NO_NUMBERS
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_what_is_no_patch_table(table, text, words):
    refused(table(text), words)


ELSEWHERE = ["/data/1.plu", "~/1.plu", r"C:\data\1.plu", r"\\server\1.plu", "../1.plu", "a/.."]


@pytest.mark.parametrize("name", [*ELSEWHERE, "a/../../1.plu"])
def test_scans_lie_in_the_scan_folder(table, name):
    text = f"{HEAD},t1,repeat\n1,1,1,{name},a,\n2,3,1,a,{name},\n3,2,3,a,b,{name}\n"
    columns = enumerate(("t0", "t1", "repeat"), start=1)
    refused(table(text), *(f"line {n + 1} (patch {n}): {each} is {name!r}" for n, each in columns))


def test_a_small_overlap_is_told_and_what_touches_is_none(table):
    text = f"{HEAD},rotation_deg\n1,1,1,a,0\n2,1.8,1,b,0\n3,2.65,1,c,0\n4,2.65,1.9,d,45\n"
    text += "5,0.425,4.575,e,0\n6,0.45,3,f,90\n"  # these touch the edge
    near, turned = overlaps(read(table(text)), 0.85)
    assert near == ("1", "2", pytest.approx(0.05 / 0.85))
    assert turned[:2] == ("3", "4")


# As `gst study` proposes them for scanning.
PLACES = """place,kind,x_mm,y_mm,exposure_N_per_mm,touched
E1,exposed,1.55,2.1,14742,1
C1,control,4.1,1.5,0,0
"""


def test_proposed_places_are_a_patch_table_as_they_stand(table, tmp_path):
    """Scans are named after their place, whatever their format; without T1 there is none."""
    path = table(PLACES)
    assert read(path).t1.tolist() == ["C1_T1.plu", "E1_T1.plu"]  # of a generated stone
    for name in ("E1_T0.plux", "e1_t1.sur", "C1_T0.plux", "E1_T0_notes", "C1_repeat.plux"):
        (tmp_path / name).touch()
    patches = read(path, scan_folder=tmp_path)
    assert patches.patch.tolist() == ["C1", "E1"]
    assert patches.t0.tolist() == ["C1_T0.plux", "E1_T0.plux"]
    assert patches.t1.tolist() == ["", "e1_t1.sur"]
    assert patches["repeat"].tolist() == ["C1_repeat.plux", ""]
    named = PLACES.replace("d\n", "d,t0,t1\n").replace(",1\n", ",1,a.plu,b.plu\n")
    assert read(table(named.replace(",0\n", ",0,c.plu,\n"))).t1.tolist() == ["", "b.plu"]


def test_a_name_with_a_star_is_that_of_the_file_that_fits(table, tmp_path):
    """As ConfoMap names what it saves."""
    stars = "*_{patch}_*_0strokes.mnt,*_{patch}_*_2000strokes.mnt"
    path = table(f"{HEAD},t1\nloc1,1,1,{stars}\nloc10,3,1,b/{{patch}}_*,\n")
    for name in ("loc1_e_0", "loc1_e_50", "loc1_e_2000", "loc10_e_0"):
        (tmp_path / f"A1_{name}strokes.mnt").touch()
    (tmp_path / "b").mkdir()
    (tmp_path / "b/Loc10_T0.sur").touch()
    patches = read(path, scan_folder=tmp_path)
    assert patches.t0.tolist() == ["A1_loc1_e_0strokes.mnt", "b/Loc10_T0.sur"]
    assert patches.t1.tolist() == ["A1_loc1_e_2000strokes.mnt", ""]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLACES, "line 2 (patch E1): E1_T0.plux and E1_T0.sur fit E1_T0.*"),
        (PLACES, "line 3 (patch C1): no file fits C1_T0.*"),
        (f"{HEAD}\nE1,1,1,{{patch}}_*\n", "E1_T0.plux and E1_T0.sur fit E1_*"),
        (f"{HEAD}\nE1,1,1,*{{patch}}_9\n", "no file fits *E1_9"),
    ],
)
def test_a_scan_that_is_missing_or_there_twice_is_told(table, tmp_path, text, words):
    for name in ("E1_T0.plux", "E1_T0.sur"):
        (tmp_path / name).touch()
    refused(table(text), f"{words} in {tmp_path}", scan_folder=tmp_path)
