"""The patch table: everything wrong with it is said at once, with line numbers."""

import re
import unicodedata
from zipfile import ZipFile

import numpy as np
import openpyxl
import pytest
from folders import fill

from gst.config.patches import overlaps, read_patches, scan_files
from gstlib.errors import ConfigError
from gstlib.io.tables import read_table, write_table

HEAD = "patch,x_mm,y_mm,t0"


def read(path, **options):
    return read_patches(path, size_mm=5.0, patch_size_mm=0.85, **options)


@pytest.fixture
def table(tmp_path):
    def write(text):
        fill(tmp_path, {"patches.csv": text})
        return tmp_path / "patches.csv"

    return write


def refused(path, *parts, **options):
    with pytest.raises(ConfigError) as caught:
        read(path, **options)
    message = str(caught.value)
    assert [part for part in (path.name, *parts) if part not in message] == []
    return message


def test_names_that_look_like_something_else_stay_names(table, tmp_path):
    """As an empty cell, a number, or yes and no."""
    names = ["007", "1e5", "7", "NA", "None", "inf", "nan", "no"]
    rows = [
        f"{name},{1 + 0.9 * (i % 4)},{1 + i // 4},a\n" for i, name in enumerate(names)
    ]
    patches = read(table(f"{HEAD}\n{''.join(rows)}"))
    assert sorted(patches.patch) == names
    write_table(tmp_path / "t.csv", patches)
    assert list(read_table(tmp_path / "t.csv").patch) == list(patches.patch)


def test_scans_are_found_however_their_accents_are_composed(table, tmp_path):
    forms = [unicodedata.normalize(form, "alt/Höhe_é.plu") for form in ("NFC", "NFD")]
    fill(tmp_path, {forms[0]: ""})
    for written in forms:
        path = table(f"{HEAD},t1\n1,1,1,{written},gone.plu\n")
        (patch,) = read(path, scan_folder=tmp_path).itertuples()
        assert (tmp_path / patch.t0).samefile(tmp_path / forms[0])
        assert patch.t1 == "gone.plu"


ROWS = [
    ["# moulds"],
    [],
    ["patch", "x_mm", "y_mm", "t0", "note"],
    ["07", "1", "1.25", "7.plu"],
    ["5", "4.5", "0.5", "5.plu", "Höhe"],
]


@pytest.mark.parametrize(
    ("encoding", "mark", "point"),
    [
        ("utf-8-sig", ",", "."),
        ("cp1252", ";", ","),
        ("utf-16", "\t", "."),
        ("", "", ""),
    ],
)
def test_tables_as_spreadsheets_write_them(table, tmp_path, encoding, mark, point):
    if encoding:
        lines = [mark.join(row + [""] * (7 - len(row))) for row in ROWS]
        text = re.sub(r"(?<=\d)\.(?=\d)", point, "\r\n".join(lines))
        path = table(text.encode(encoding))
    else:
        path = tmp_path / "p.xlsx"
        book = openpyxl.Workbook()
        for row in ROWS:
            book.active.append(row)
        book.active = book.create_sheet("notes")  # was open when it was saved
        book.save(path)
    patches = read(path)
    assert list(patches.patch) == ["5", "07"]  # as text, in natural order
    assert patches[["x_mm", "y_mm"]].values.tolist() == [[4.5, 0.5], [1.0, 1.25]]
    assert list(patches.note) == ["Höhe", ""]
    assert np.isnan(patches.crop_x_mm).all()


@pytest.mark.parametrize("stored", ["", "5_T1.plu"])
def test_a_formula_stands_for_its_stored_value(tmp_path, stored):
    """An empty text is one, too; a formula that was never computed has none."""
    path, never = tmp_path / "p.xlsx", tmp_path / "never.xlsx"
    book = openpyxl.Workbook()
    book.active.append(["patch", "x_mm", "y_mm", "t0", "t1"])
    book.active.append(["5", 4.5, 0.5, "5_T0.plu", '=IF(1, "", "")'])
    book.save(never)
    refused(never, "never.xlsx, cell E2: its formula has no stored value")
    with ZipFile(never) as old, ZipFile(path, "w") as new:
        for name in old.namelist():
            text = old.read(name).decode()
            if name.endswith("sheet1.xml"):  # as a spreadsheet program writes it
                value = f"</f><v>{stored}</v>"
                text = re.sub(r"</f><v ?/>|</f><v></v>", value, text)
                text = text.replace('r="E2"', 'r="E2" t="str"')
            new.writestr(name, text)
    assert read(path).t1.tolist() == [stored]


def test_a_repeat_is_a_scan_of_the_same_piece(table, tmp_path):
    path = table(f"{HEAD},repeat,crop_x_mm,crop_y_mm\n1,1,1,a.plu,b.plu,0.2,-0.1\n")
    first, again = scan_files(read(path, scan_folder=tmp_path), tmp_path, None)
    assert again == first._replace(path=tmp_path / "b.plu", epoch="repeat")
    assert first.crop == (-0.1, 0.2)  # y, x


def test_all_problems_at_once(table):
    message = refused(
        table(
            f"{HEAD},rotation_deg,crop_x_mm,crop_y_mm\n"
            "p1,1,1,a,,,\n"
            "P1,2,2,b,,,\n"  # some file systems ignore the case
            "a/b,3,2,c,,,\n"
            "all,3,1,c,,,\n"  # which tables call all patches together
            "4,4.9,0.4,e,,,\n"
            "5,,2,,,,\n"
            "6,1,3,f,400,0.5,\n"
            "9,3,3,i,,,,extra\n"
        ),
        "line 3 (patch P1): same id as in line 2",
        "line 4 (patch a/b): patch is 'a/b'",
        "line 5 (patch all): patch is 'all'",
        "line 6 (patch 4): its footprint",
        "0.325 mm at the x = 5 side and 0.025 mm at the y = 0 side",
        "line 7 (patch 5): x_mm is empty",
        "line 7 (patch 5): t0 is empty",
        "line 8 (patch 6): crop_y_mm is empty",
        "line 8 (patch 6): rotation_deg is 400",
        "line 9 (patch 9): 8 cells in 7 columns",
        "9 problems",
    )
    assert "line 2 " not in message


REFUSED = [
    ("patch,x_mm,t0\n1,1,1\n", "y_mm"),
    (f"{HEAD},pressure\n1,1,1,1,1\n", "pressure"),
    (f"{HEAD}\n", "no rows"),
    (b"PK\x03\x04\x14\0" + bytes(range(256)), "save it as CSV"),
    (f"{HEAD}\nloc 1_a,1,1,a\n", "write loc-1-a"),
    (f"{HEAD},t1\n1,1,1,,a\n", "t0 is empty"),
    (f"{HEAD},wear_grade\n1,1,1,a,2\n", "wear_grade stands beside scans"),
    (f"{HEAD},wear_grade\n1,1,1,,0.5\n", "wear_grade is 0.5, not a whole number"),
    (f"# mine\n{HEAD}, X_MM\n1,1,1,a,2\n", "two columns of one name"),
    (f"{HEAD},\ufeffｘ_mm\n1,1,1,a,2\n", "two columns of one name"),
    (f"{HEAD},t1\n1,1,1,a\n", "line 2 (patch 1): 4 cells in 5 columns"),
    (f'{HEAD},note\n1,1,1,a,"\n2,3,1,b,\n', "cannot be read"),
    (
        "patch;x_mm;y_mm;t0\n1;1.500;0;a\n2;1;2,5;b\n",
        "line 2 (patch 1): x_mm is '1.500'",
    ),
    (f"{HEAD}\n#N/A,1,1,a\n2,3,1,b\n", "line 2 (patch #N/A): patch is"),
    (f"{HEAD}\n1,0,5,1,5,a\n", "use semicolons or tabs"),
    # of a spreadsheet, comments and blank rows count as lines
    (
        '"# a; b";;;\n;;;\npatch;x_mm;y_mm;t0\n2;1.234,5;1;b\n',
        "line 4 (patch 2): x_mm is '1.234,5'",
    ),
    (f"{HEAD},rotation_deg\n1,0.45,1,a,45\n", "0.151 mm at the x = 0 side"),
]
REFUSED += [
    (f"{HEAD}\n1,{cell},1,a\n", f"line 2 (patch 1): x_mm is '{cell}'")
    for cell in ("inf", "nan", "1_5", "0x10", "١.٥", "1mm", "#DIV/0!")
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_what_is_no_patch_table(table, text, words):
    refused(table(text), words)


@pytest.mark.parametrize(
    "name", ["/data/1.plu", "~/1.plu", r"C:\data\1.plu", "a/../../1.plu"]
)
def test_scans_lie_in_the_scan_folder(table, name):
    text = f"{HEAD},t1\n1,1,1,{name},a\n2,3,1,a,{name}\n"
    refused(table(text), f"(patch 1): t0 is {name!r}", f"(patch 2): t1 is {name!r}")


def test_a_small_overlap_is_told_and_what_touches_is_none(table):
    rows = (
        "1,1,1,a\n2,1.8,1,b\n3,2.65,1,c\n5,0.425,4.575,e\n"  # the last touches the edge
    )
    ((*pair, share),) = overlaps(read(table(f"{HEAD}\n{rows}")), 0.85)
    assert (pair, share) == (["1", "2"], pytest.approx(0.05 / 0.85))


# As `gst study` proposes them for scanning.
PLACES = """place,kind,x_mm,y_mm,exposure_N_per_mm,touched
E1,exposed,1.55,2.1,14742,1
C1,control,4.1,1.5,0,0
"""


def test_proposed_places_are_a_patch_table_as_they_stand(table, tmp_path):
    """Scans are named after their place, whatever their format; without T1 there is none."""
    path = table(PLACES)
    assert read(path).t1.tolist() == ["C1_T1.plu", "E1_T1.plu"]  # of a generated stone
    for name in (
        "E1_T0.plux",
        "e1_t1.sur",
        "C1_T0.plux",
        "E1_T0_notes",
        "C1_repeat.plux",
    ):
        (tmp_path / name).touch()
    patches = read(path, scan_folder=tmp_path).set_index("patch")
    scans = patches[["t0", "t1", "repeat"]].T.to_dict("list")
    assert scans == {
        "C1": ["C1_T0.plux", "", "C1_repeat.plux"],
        "E1": ["E1_T0.plux", "e1_t1.sur", ""],
    }


def test_a_name_with_a_star_is_that_of_the_file_that_fits(table, tmp_path):
    """As ConfoMap names what it saves."""
    path = table(
        f"{HEAD}\nloc1,1,1,*_{{patch}}_*_0strokes.mnt\nloc10,3,1,b/{{patch}}_*\n"
    )
    names = ["A1_loc1_e_0strokes.mnt", "b/Loc10_T0.sur"]
    others = ["A1_loc1_e_50strokes.mnt", "A1_loc10_e_0strokes.mnt"]
    fill(tmp_path, dict.fromkeys([*names, *others], ""))
    assert read(path, scan_folder=tmp_path).t0.tolist() == names


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLACES, "line 2 (patch E1): E1_T0.plux and E1_T0.sur fit E1_T0.*"),
        (PLACES, "line 3 (patch C1): no file fits C1_T0.*"),
        (f"{HEAD}\nE1,1,1,*{{patch}}_9\n", "no file fits *E1_9"),
    ],
)
def test_a_scan_that_is_missing_or_there_twice_is_told(table, tmp_path, text, words):
    fill(tmp_path, {"E1_T0.plux": "", "E1_T0.sur": ""})
    refused(table(text), f"{words} in {tmp_path}", scan_folder=tmp_path)
