"""Height maps in text as many programs write them: the right heights, or a clear refusal."""

import numpy as np
import pytest
from scan_files import CONFIG, STEP, lines_of, refused

from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of

NY, NX = 24, 30


# Heights (µm), rough along both axes, with four decimals.
STEPS = np.random.default_rng(5).normal(size=(NY, NX))
HEIGHTS = (STEPS.cumsum(0).cumsum(1) / 10).round(4)
X, Y = np.arange(NX) * STEP, np.arange(NY) * STEP


def first_as(word, text):
    return word + "," + text.partition(",")[2]


def with_coordinates(x=X, y=Y, corner=0.0):
    return np.vstack([np.r_[corner, x], np.c_[y, HEIGHTS]])


def points(order=(0, 1, 2), scale=(1, 1, 1)):
    y, x = np.indices(HEIGHTS.shape) * STEP
    columns = np.column_stack([x.ravel(), y.ravel(), HEIGHTS.ravel()]) * scale
    return columns[:, list(order)]


def same(scan, heights=HEIGHTS, steps=(STEP, STEP)):
    np.testing.assert_allclose(1e3 * scan, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx([1e-3 * step for step in steps])


COMMA = str.maketrans(".", ",")
PLAIN = lines_of(HEIGHTS)
DIALECTS = {
    "blanks and decimal commas": lines_of(HEIGHTS, "  ").translate(COMMA),
    "quotes": lines_of(HEIGHTS, cell='"{:.4f}"'),
    "a true minus": PLAIN.replace("-", "−"),
    "exponents of Fortran": lines_of(HEIGHTS, " ", "{:.6e}").replace("e", "D"),
    "separators and blank lines": PLAIN.replace("\n", ",\n\n"),
    "names of columns": ",".join(f"c{n}" for n in range(NX)) + f"\n{PLAIN}",
    "the config's unit": f"# heights in um\n{PLAIN}",
    "a time of day": f"# Measured 3:20:11 pm\n{PLAIN}",
    "coordinates": lines_of(with_coordinates()),
    "tabs, decimal commas": lines_of(with_coordinates(), "\t").translate(COMMA),
    "a word as corner": first_as("DATA\nX\\Y", lines_of(with_coordinates())),
    "coordinates in a column": lines_of(np.c_[Y, HEIGHTS]),
    "coordinates in a row": lines_of(np.vstack([X, HEIGHTS])),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_matrix_in_a_dialect(write, dialect):
    same(read_scan(write("a.csv", DIALECTS[dialect]), **CONFIG))


PLANE = np.add.outer(np.arange(NY) * 0.1, np.arange(NX) * 0.2)
TILTED = (PLANE * 9 + HEIGHTS / 100).round(4)
WITH_COORDINATES = np.vstack([np.r_[0.0, X], np.c_[Y, TILTED]])
FEW_STEPS = HEIGHTS.round(2) / 100 + PLANE * 10
WHOLE = (HEIGHTS * 1e3).round()
OTHERS = {
    "coordinates of a smooth map": (TILTED, lines_of(WITH_COORDINATES)),
    "heights in even steps": (PLANE, lines_of(PLANE)),
    "heights in few steps": (FEW_STEPS, lines_of(FEW_STEPS)),
    "whole numbers": (WHOLE, lines_of(WHOLE, cell="{:.0f}")),
    "whole numbers above 0": (WHOLE + 2e4, lines_of(WHOLE + 2e4, cell="{:.0f}")),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_heights_are_told_from_coordinates_and_from_split_numbers(write, kind):
    heights, text = OTHERS[kind]
    same(read_scan(write("a.csv", text), **CONFIG), heights)


def test_coordinates_give_the_order_and_the_spacing_and_the_config_the_unit(write):
    text = lines_of(with_coordinates(X[::-1], 2 * Y[::-1]))
    scan = read_scan(write("a.csv", text), unit="um")
    same(scan, np.flip(HEIGHTS), steps=(2 * STEP, STEP))
    numbers = lines_of(with_coordinates(np.arange(NX), np.arange(NY)))
    spacing = "spacing of its points.*scans.spacing_um"
    refused(write("a.csv", numbers), spacing, unit="um")
    unit = "state its unit.*scans.unit"
    refused(write("a.csv", PLAIN), unit, spacing_um=STEP)


MARKS = [
    "*****",
    "#N/A",
    "#DIV/0!",
    "#¡VALOR!",
    "No Data",
    "--",
    "-nan(ind)",
    "1.#QNAN",
    "inf",
]


@pytest.mark.parametrize("mark", MARKS)
@pytest.mark.parametrize("separator", [";", " "])
def test_marks_of_unmeasured_points(write, mark, separator):
    """In whole rows at the top, at the ends of rows, and in most of the file."""
    heights = HEIGHTS.copy()
    heights[np.random.default_rng(1).random(heights.shape) < 0.8] = np.nan
    heights[:3] = heights[:, -1] = np.nan
    same(
        read_scan(
            write("a.csv", lines_of(heights, separator, unmeasured=mark)), **CONFIG
        ),
        heights,
    )


@pytest.mark.parametrize("coding", ["utf-8", "utf-16"])
def test_a_header_of_gwyddion(write, coding):
    header = "# Channel: Z\n# Width: 45,0 µm\n# Height: 7.2e1 µm\n# Value units: nm\n"
    text = header + lines_of(HEIGHTS * 1e3, "\t")
    # a unit and a spacing that do not count
    path = write("a.txt", text.encode(coding))
    scan = read_scan(path, unit="mm", spacing_um=9.0)
    same(scan, steps=(3.0, 1.5))


HEADERS = [
    "# Kanal: a\n# Breite: 240.0 µm\n# Höhe: 180.0 µm\n# Value units: m\n",
    "# Value units: m\n",
    "# Unità dei valori: m\n",
    "heights [nm]\n",
    "Height nm\n",
    "Height;nm\n",
    "Height in nanometres\n",
    "dx = 0.5\n",
    "pixel size=1.5e-006 m\n",
    "DSAA\n30 24\n0 45\n0 36\n",
    "1.5,#####,2.5,1.5\n",
]


@pytest.mark.parametrize("header", HEADERS)
@pytest.mark.parametrize(("name", "rows"), [("a.csv", HEIGHTS), ("a.xyz", points())])
def test_a_header_that_is_not_understood_is_refused(write, header, name, rows):
    text = header + lines_of(rows)
    refused(write(name, text), "states a unit or a size|damaged", **CONFIG)


MAPS = {
    "two maps, a blank line": (f"{PLAIN}\n{PLAIN}", "blocks"),
    "split at commas": (PLAIN.translate(COMMA), "commas between its cells"),
    "thousands": (lines_of(HEIGHTS + 1500, ";", "{:,.4f}"), "thousands"),
    "hashes": (PLAIN.replace(",", ",####,", 1), "damaged"),
    "split and trimmed": (
        lines_of(HEIGHTS + 0.0001, cell="{:.7g}").translate(COMMA),
        "commas between its cells",
    ),
    "thousands of nanometres": (
        lines_of(HEIGHTS * 1e3, "\t", "{:,.0f}"),
        "between thousands",
    ),
    "thousands with points": (
        lines_of(HEIGHTS * 1e3, ";", "{:,.0f}").replace(",", "."),
        "between thousands",
    ),
    "an unknown mark": ("void,void,void,void\n" + "1,2,3,4\n" * 9, "'void' in 3 cells"),
    "other spacing": (
        lines_of(with_coordinates(2 * X, 2 * Y)),
        "coordinates are 3 apart",
    ),
    "uneven": (lines_of(with_coordinates(X**1.1 + 60, Y)), "uneven"),
    "two rows": (
        lines_of(np.vstack([np.arange(NX), X, HEIGHTS])),
        "two rows or columns",
    ),
    "a word as height": (first_as("word", PLAIN), "its first cell is 'word'"),
    "a table of points": (
        "x,y,z,i\n" + lines_of(points((0, 1, 2, 2))),
        "4 columns and 720 rows",
    ),
}


@pytest.mark.parametrize("kind", MAPS)
def test_a_matrix_that_would_be_misread_is_refused(write, kind):
    text, match = MAPS[kind]
    refused(write("a.csv", text), match, **CONFIG)


def test_coordinates_in_another_unit_make_slopes_that_no_stone_has(write):
    text = lines_of(with_coordinates(X / 1e3, Y / 1e3))
    refused(write("a.csv", text), "different units", unit="um")
    text = lines_of(points(scale=(1, 1, 1e3)), " ", "{:.7f}")
    refused(write("a.xyz", text), "different units.*x.mm. y.mm. z.um.", unit="um")


@pytest.mark.parametrize(
    ("head", "order", "scale"),
    [
        ("", (0, 1, 2), (1, 1, 1)),
        ("# z x y\n", (2, 0, 1), (1, 1, 1)),
        ("# X (µm), Y (µm), Z (nm)\n", (0, 1, 2), (1, 1, 1e3)),
        ("z_nm x_mm y_um\n", (2, 0, 1), (1e-3, 1, 1e3)),
    ],
)
def test_points_with_names_and_units_of_their_columns(write, head, order, scale):
    """Invisible lines at the end are no points."""
    text = head + lines_of(points(order, scale), " ", "{:.7f}") + "\t\n\xa0\n"
    same(read_scan(write("a.xyz", text), unit="um"))


@pytest.mark.parametrize("head", ["Row Col Height\n", "x[px] y[px] z\n"])
def test_points_with_other_names_are_refused(write, head):
    text = head + lines_of(points(), " ")
    refused(write("a.xyz", text), "not clear|not understood", unit="um")


def test_numbers_of_points_are_no_lengths(write, caplog):
    text = lines_of(points(scale=(1 / STEP, 1 / STEP, 1)), " ")
    same(read_scan(write("a.xyz", text), unit="um"), steps=(1, 1))
    assert "whole numbers, 1 apart" in caplog.text
    refused(write("a.xyz", text), "whole numbers, 1 apart.*1.5", **CONFIG)
