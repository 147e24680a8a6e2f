"""Height maps in text as many programs write them: the right heights, or a clear refusal."""

import numpy as np
import pytest
from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of
from scan_files import refused

STEP = 1.5  # µm
CONFIG = {"unit": "um", "spacing_um": STEP}
NY, NX = 24, 30


def rough():
    """Heights (µm), rough along both axes, with four decimals."""
    heights = np.random.default_rng(5).normal(size=(NY, NX)).cumsum(0).cumsum(1)
    return (heights / 10).round(4)


HEIGHTS = rough()
X, Y = np.arange(NX) * STEP, np.arange(NY) * STEP


def lines_of(rows, mark=",", cell="{:.4f}", unmeasured="nan"):
    cells = ([unmeasured if v != v else cell.format(v) for v in row] for row in rows)
    return "".join(f"{mark.join(row)}\n" for row in cells)


def first_as(word, text):
    return word + "," + text.partition(",")[2]


def with_coordinates(x=X, y=Y, corner=0.0, heights=HEIGHTS):
    return np.vstack([np.r_[corner, x], np.c_[y, heights]])


def points(order=(0, 1, 2), scale=(1, 1, 1)):
    y, x = np.indices(HEIGHTS.shape) * STEP
    columns = np.column_stack([x.ravel(), y.ravel(), HEIGHTS.ravel()]) * scale
    return columns[:, list(order)]


def read(tmp_path, text, ending=".csv", **config):
    path = tmp_path / f"a{ending}"
    path.write_text(text, encoding="utf-8")
    return read_scan(path, **config)


def same(scan, heights=HEIGHTS, steps=(STEP, STEP)):
    np.testing.assert_allclose(1e3 * scan.values, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx([1e-3 * step for step in steps])


COMMA = str.maketrans(".", ",")
DIALECTS = {
    "blanks and decimal commas": lines_of(HEIGHTS, "  ").translate(COMMA),
    "quotes": lines_of(HEIGHTS, cell='"{:.4f}"'),
    "a true minus": lines_of(HEIGHTS, ";").replace("-", "−"),
    "exponents of Fortran": lines_of(HEIGHTS, " ", "{:.6e}").replace("e", "D"),
    "separators at line ends": lines_of(HEIGHTS).replace("\n", ",\n"),
    "a blank line after each": lines_of(HEIGHTS).replace("\n", "\n\n"),
    "a comment above": "# made by us, 2024-05-01 10:30\n" + lines_of(HEIGHTS),
    "sep=": "sep=;\n" + lines_of(HEIGHTS, ";"),
    "names of columns": ",".join(f"c{n}" for n in range(NX)) + "\n" + lines_of(HEIGHTS),
    "the config's unit": "# heights in um\n" + lines_of(HEIGHTS),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_matrix_in_a_dialect(tmp_path, dialect):
    same(read(tmp_path, DIALECTS[dialect], **CONFIG))


@pytest.mark.parametrize("heights", [HEIGHTS * 1e3, HEIGHTS * 1e3 + 2e4, np.clip(HEIGHTS, 1, 9)])
def test_whole_numbers_are_not_taken_for_split_ones(tmp_path, heights):
    whole = heights.round()
    same(read(tmp_path, lines_of(whole, cell="{:.0f}"), unit="nm", spacing_um=STEP), whole / 1e3)


MARKS = ["***", "*****", "#N/A", "#NV", "#DIV/0!", "#¡VALOR!", "NA", "null", "No Data", "--", "BAD"]
MARKS += ["-nan(ind)", "-1.#IND", "1.#QNAN", "inf"]


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("separator", [",", ";", " "])
def test_marks_of_unmeasured_points(tmp_path, mark, separator):
    """In whole rows at the top, at the ends of rows, and in most of the file."""
    few, most = HEIGHTS.copy(), HEIGHTS.copy()
    few[:3] = few[:, -1] = few[8, 0] = np.nan
    most[np.random.default_rng(1).random(most.shape) < 0.9] = most[:8] = np.nan
    for heights in (few, most):
        same(read(tmp_path, lines_of(heights, separator, unmeasured=mark), **CONFIG), heights)


FLIPPED = np.flip(HEIGHTS)
COORDINATES = {
    "both": (lines_of(with_coordinates()), HEIGHTS),
    "both, tabs, decimal commas": (lines_of(with_coordinates(), "\t").translate(COMMA), HEIGHTS),
    "from below zero": (lines_of(with_coordinates(X - 20, Y - 30)), HEIGHTS),
    "in falling order": (lines_of(with_coordinates(X[::-1], Y[::-1])), FLIPPED),
    "without a corner": (first_as("", lines_of(with_coordinates())), HEIGHTS),
    "a word as corner": (first_as("DATA\nX\\Y", lines_of(with_coordinates())), HEIGHTS),
    "in a column": (lines_of(np.c_[Y, HEIGHTS]), HEIGHTS),
    "in a row": (lines_of(np.vstack([X, HEIGHTS])), HEIGHTS),
    "numbers": (lines_of(with_coordinates(np.arange(NX), np.arange(NY))), HEIGHTS),
    "numbers from 1": (lines_of(np.c_[np.arange(NY) + 1, HEIGHTS]), HEIGHTS),
}


@pytest.mark.parametrize("kind", COORDINATES)
def test_coordinates_are_not_heights(tmp_path, kind):
    text, heights = COORDINATES[kind]
    same(read(tmp_path, text, **CONFIG), heights)


def test_coordinates_give_the_spacing(tmp_path):
    text = lines_of(with_coordinates(X, 2 * Y))
    same(read(tmp_path, text, unit="um"), steps=(2 * STEP, STEP))
    (tmp_path / "b.csv").write_text(lines_of(with_coordinates(np.arange(NX), np.arange(NY))))
    refused(tmp_path / "b.csv", "spacing of its points", unit="um")


def test_heights_in_even_steps_are_not_coordinates(tmp_path):
    plane = np.add.outer(np.arange(NY) * 0.1, np.arange(NX) * 0.2)
    tilted = HEIGHTS.round(2) / 100 + plane * 10
    for heights in (plane, tilted, np.where(X > 20, 5.0, 1.0) + 0 * HEIGHTS):
        same(read(tmp_path, lines_of(heights), **CONFIG), heights)


GWYDDION = "# Channel: Z\n# Width: {x} µm\n# Height: {y} µm\n# Value units: {unit}\n"


@pytest.mark.parametrize(
    ("x", "y", "unit", "scale"),
    [("45,0", "72,0", "nm", 1e3), ("4.5e1", "72", "µm", 1), ("45", "72", "cm", 1e-4)],
)
def test_a_header_of_gwyddion(tmp_path, x, y, unit, scale):
    text = lines_of(HEIGHTS * scale, "\t", "{:.9g}")
    other = {"unit": "mm", "spacing_um": 9.0}  # which do not count
    scan = read(tmp_path, GWYDDION.format(x=x, y=y, unit=unit) + text, ".txt", **other)
    same(scan, steps=(3.0, 1.5))


HEADERS = [
    "# Kanal: a\n# Breite: 240.0 µm\n# Höhe: 180.0 µm\n# Value units: m\n",
    "# Largeur : 240.0 µm\n# Hauteur : 180.0 µm\n# Unités des valeurs : m\n",
    *("# Value units: m\n", "# Width: 45 µm\n", "# Einheit der Werte: m\n", "# Unidad: m\n"),
    *("# Unità dei valori: m\n", "Einheit;nm\n", "heights [nm]\n", "Height in nanometres\n"),
    *("dx = 0.5\n", "XINC 0.5\n", "cellsize 0.5\n", "ncols 30\n", "Pixelgröße: 0.5\n"),
    *("Schrittweite 0.5\n", "scale factor=6.3e-008\n", "pixel size=1.5e-006 m\n"),
    *("30 24\n", "0.0015\n", "DSAA\n30 24\n0 45\n0 36\n", "1,2\n", "1.5,#####,2.5,1.5\n"),
    ",".join(f"{x} nm" for x in X) + "\n",
]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize("ending", [".csv", ".xyz"])
def test_a_header_that_is_not_understood_is_refused(tmp_path, header, ending):
    path = tmp_path / f"a{ending}"
    path.write_text(header + lines_of(HEIGHTS if ending == ".csv" else points()))
    refused(path, "states a unit or a size|damaged", **CONFIG)


MAPS = {
    "two maps, a blank line": (lines_of(HEIGHTS) + "\n" + lines_of(HEIGHTS), "blocks"),
    "two maps, comments": ("# z\n" + lines_of(HEIGHTS) + "# i\n" + lines_of(HEIGHTS), "blocks"),
    "split at commas": (lines_of(HEIGHTS).translate(COMMA), "commas between its cells"),
    "split, none below zero": (
        lines_of(HEIGHTS + 50, cell="{:.2f}").translate(COMMA),
        "commas between",
    ),
    "thousands": (lines_of(HEIGHTS + 1500, ";", "{:,.4f}"), "thousands"),
    "thousands, German": ("1.234,5;2;3;4\n" * 9, "thousands"),
    "one of them": ("1,5;2;3;4\n" * 9 + "1.234;2,5;3;4\n", "thousands"),
    "hashes": (lines_of(HEIGHTS).replace(",", ",####,", 1), "damaged"),
    "hashes first": (first_as("####", lines_of(HEIGHTS)), "####"),
    "an unknown mark": ("void,void,void,void\n" + "1,2,3,4\n" * 9, "'void' in 3 cells"),
    "a comment behind a row": ("1,2,3,4\n1,2,3,4 # mine\n", "# mine"),
    "two separators": (lines_of(HEIGHTS, ";").replace(";", "\t", 5), "damaged"),
    "an underscore": (first_as("1_0", lines_of(HEIGHTS)), "1_0"),
    "wide digits": (lines_of(HEIGHTS).replace("2", "２"), "no row of numbers|not a table"),
    "other spacing": (lines_of(with_coordinates(2 * X, 2 * Y)), "coordinates are 3 apart"),
    "uneven": (lines_of(with_coordinates(X**1.1 + 60, Y)), "uneven"),
    "two rows": (lines_of(np.vstack([np.arange(NX), X, HEIGHTS])), "two rows or columns"),
    "a unit in the corner": (first_as("x [nm]", lines_of(with_coordinates())), "states a unit"),
    "a word as height": (first_as("word", lines_of(HEIGHTS)), "its first cell is 'word'"),
    "a table of points": ("x,y,z,i\n" + lines_of(points((0, 1, 2, 2))), "4 columns and 720 rows"),
}


@pytest.mark.parametrize("kind", MAPS)
def test_a_matrix_that_would_be_misread_is_refused(tmp_path, kind):
    text, words = MAPS[kind]
    (tmp_path / "a.csv").write_text(text)
    refused(tmp_path / "a.csv", words, **CONFIG)


def test_coordinates_in_another_unit_make_slopes_that_no_stone_has(tmp_path):
    (tmp_path / "a.csv").write_text(lines_of(with_coordinates(X / 1e3, Y / 1e3)))
    refused(tmp_path / "a.csv", "two units", unit="um")
    for scale in ((1e-3, 1e-3, 1), (1, 1, 1e3)):
        (tmp_path / "a.xyz").write_text(lines_of(points(scale=scale), " ", "{:.7f}"))
        refused(tmp_path / "a.xyz", "two units.*x.mm. y.mm. z.um.", unit="um")


def test_commas_that_may_separate_thousands_are_told(tmp_path, caplog):
    thousands = (HEIGHTS + 1500).round(3)
    text = lines_of(thousands / 1e3, ";", "{:.3f}").translate(COMMA)
    same(read(tmp_path, text, **CONFIG), (thousands / 1e3).round(3))
    assert "its commas are read as decimal signs" in caplog.text


@pytest.mark.parametrize(
    ("head", "order", "scale"),
    [
        ("x y z\n", (0, 1, 2), (1, 1, 1)),
        ("# z x y\n", (2, 0, 1), (1, 1, 1)),
        ("X Z Y\n", (0, 2, 1), (1, 1, 1)),
        ("n x y z\n", (2, 0, 1, 2), (1, 1, 1)),
        ("x[mm] y[mm] z[um]\n", (0, 1, 2), (1e-3, 1e-3, 1)),
        ("# X (µm), Y (µm), Z (nm)\n", (0, 1, 2), (1, 1, 1e3)),
        ("z_nm x_mm y_um\n", (2, 0, 1), (1e-3, 1, 1e3)),
    ],
)
def test_points_with_names_and_units_of_their_columns(tmp_path, head, order, scale):
    text = lines_of(points(order, scale), " ", "{:.7f}")
    same(read(tmp_path, head + text, ".xyz", unit="um"))


@pytest.mark.parametrize("head", ["Row Col Height\n", "East North Up\n", "x[px] y[px] z\n"])
def test_points_with_other_names_are_refused(tmp_path, head):
    (tmp_path / "a.xyz").write_text(head + lines_of(points(), " "))
    refused(tmp_path / "a.xyz", "not clear|not understood", unit="um")


def test_numbers_of_points_are_no_lengths(tmp_path, caplog):
    text = lines_of(points(scale=(1 / STEP, 1 / STEP, 1)), " ")
    for spacing_um in (None, 1.0):
        same(read(tmp_path, text, ".xyz", unit="um", spacing_um=spacing_um), steps=(1, 1))
    assert len(caplog.messages) == 1
    assert "whole numbers, 1 apart" in caplog.text
    refused(tmp_path / "a.xyz", "whole numbers, 1 apart.*states 1.5", **CONFIG)
