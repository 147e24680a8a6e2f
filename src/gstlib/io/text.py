"""Height maps in text: matrices (.csv, .txt, .asc), a row of the map a line, and points (.xyz).

NumPy reads the cells, and strictly: a row of another length, or a word among the numbers, is a
damaged file. Of headers, those of Gwyddion's matrices and of ESRI's grids are understood; others
leave unit and spacing to the config.
"""

import itertools
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from gstlib.errors import InputError

__all__ = [
    "FORMULA_ERROR",
    "SCAN_UNITS",
    "decoded",
    "read_matrix",
    "read_points",
    "separator_of",
]

# Length of each unit in mm.
SCAN_UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}

# A cell whose formula failed, as spreadsheets in several languages write it. No comment begins so.
FORMULA_ERROR = re.compile(r"#(N/?[A-Z]|[^\sa-z,;]{2,}[!?])(?![^\s,;\"])")
# Cells that stand for an unmeasured point, except empty ones and NaN, which NumPy knows.
_UNMEASURED = re.compile(r"\bbad\b|---", re.IGNORECASE)
# Lines above an ESRI grid; others state its corner. Its cells are unmeasured by a number.
_ESRI = re.compile(
    r"^\s*(ncols|nrows|cellsize|dx|dy|nodata_value)\s+(\S+)\s*$", re.IGNORECASE | re.MULTILINE
)
_ESRI_UNMEASURED = -9999.0
# Coordinates in text are rounded: a point belongs to a grid if within this share of a step.
_GRID_TOLERANCE = 0.05
# If points fill a smaller share of their grid, they are scattered, or one of them is far off.
_LEAST_FILLED = 0.25
_LARGEST_SIDE = 1 << 16
# A last line that lacks more points than so many times the longest row of unmeasured ones is cut.
_CUT_TIMES = 2
# Numbers of a column of points, or of a matrix, are written with equally many decimals, or with
# many different counts. If up to this share of them differs, digits were lost or added.
_ODD_FRACTION = 1e-3


def read_matrix(
    path: Path,
) -> tuple[np.ndarray, tuple[float, float] | None, float | None, dict[str, str]]:
    """Read a matrix of heights, as a reader of `gstlib.io.scans`."""
    header, heights = _read_rows(path)
    grid = {name.lower(): cell for name, cell in _ESRI.findall(header)}
    if {"ncols", "nrows"} <= grid.keys():
        return _esri_grid(path, grid, heights)
    ny, nx = heights.shape
    stated = {
        name: float(number or 1) * SCAN_UNITS[unit]
        for name, number, unit in re.findall(
            r"^# *(Width|Height|Value)(?: units)?: *([\d.eE+-]*) *(m|mm|um|nm)$",
            header.replace("µ", "u").replace("μ", "u"),
            re.MULTILINE,
        )
    }
    if nx < 3 or (nx == 3 < ny and not stated):
        raise InputError(
            path,
            f"has {nx} columns and {ny} rows, as profiles and points have, not a map",
            "If it holds points x, y, z, change its ending to .xyz; else export the whole map.",
        )
    if len(stated) < 3:
        return heights, None, None, {}
    unit = stated["Value"]
    return heights, (stated["Height"] / ny / unit, stated["Width"] / nx / unit), unit, {}


def _esri_grid(
    path: Path, header: Mapping[str, str], heights: np.ndarray
) -> tuple[np.ndarray, tuple[float, float], None, dict[str, str]]:
    """Heights and spacing of an ESRI ASCII grid, whose first row is that of the highest y."""
    try:
        stated = {name: float(cell.replace(",", ".")) for name, cell in header.items()}
        shape = stated["nrows"], stated["ncols"]
        spacing = [stated[name if name in stated else "cellsize"] for name in ("dy", "dx")]
    except (KeyError, ValueError) as error:
        problem = f"the header of an ESRI grid states no number for {error}"
        raise InputError(path, problem, "Export the grid again.") from error
    if heights.shape != shape:
        ny, nx = heights.shape
        raise InputError(
            path,
            f"holds {ny} rows of {nx} heights, but its header states {shape[0]:g} of {shape[1]:g}",
            "Export it again, with one row of the grid a line.",
        )
    heights[heights == stated.get("nodata_value", _ESRI_UNMEASURED)] = np.nan
    return heights[::-1], (spacing[0], spacing[1]), None, {}


def read_points(path: Path) -> tuple[np.ndarray, tuple[float, float], None, dict[str, str]]:
    """Read points on a grid, as a reader of `gstlib.io.scans`."""
    points = _read_rows(path, columns=range(3))[1]
    # A point without x or y has no place; one without z is unmeasured.
    points = points[np.isfinite(points[:, :2]).all(axis=1)]
    columns, dx = _grid_lines(path, points[:, 0])
    rows, dy = _grid_lines(path, points[:, 1])
    ny, nx = int(rows.max()) + 1, int(columns.max()) + 1
    places = rows * nx + columns
    if not len(np.unique(places)) == len(points) >= _LEAST_FILLED * ny * nx:
        raise _scattered(path, len(points))
    _refuse_cut_grid(path, rows, columns)
    heights = np.full((ny, nx), np.nan)
    heights[rows, columns] = points[:, 2]
    return heights, (dy, dx), None, {}


def separator_of(line: str) -> str | None:
    """Separator of a line's cells, None for blanks.

    >>> [separator_of(line) for line in ("1,5; 2", "1,5\\t2", "1, 2", "1 2")]
    [';', '\\t', ',', None]
    """
    return next((mark for mark in ";\t," if mark in line), None)


def decoded(content: bytes) -> str:
    """Text in UTF-16, if it begins with its byte order mark, else in UTF-8."""
    is_utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return content.decode("utf-16" if is_utf_16 else "utf-8-sig")


def _read_rows(path: Path, columns: Sequence[int] | None = None) -> tuple[str, np.ndarray]:
    """The lines above the first row of numbers, and the cells, or some `columns`, of all rows."""
    content = path.read_bytes()
    try:
        text = decoded(content)
    except UnicodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        raise InputError(path, "is not text, though its name says so", "Correct its ending.")
    lines = text.splitlines()
    rows = [line.partition("#")[0].strip(" ") for line in lines]
    first = next((n for n, row in enumerate(rows) if _begins_with_numbers(row)), None)
    if first is None:
        raise InputError(path, "has no row of numbers", "Export the whole topography as text.")
    rows = list(filter(None, rows[first:]))
    mark = separator_of(rows[0])
    if columns is not None:
        _refuse_cut_lines(path, text, rows, mark)
    if mark and all(row.endswith(mark) for row in rows):  # which adds one empty cell
        rows = [row[:-1] for row in rows] if columns is None else rows
    try:
        numbers = _numbers(rows, mark, columns)
    except ValueError as error:
        problem = (
            f"from line {first + 1} on, is not a table of numbers: {str(error).split(';')[0]}"
        )
        remedy = "Unmeasured points are empty cells, NaN, BAD or ---; comments begin with '#'."
        raise InputError(path, problem, f"Export or copy the file again. {remedy}") from error
    if columns is None:
        _refuse_odd_decimals(path, rows, mark)
    for n in columns or ():
        _refuse_odd_decimals(path, (row.split(mark)[n] for row in rows), mark)
    return "\n".join(lines[:first]), numbers


def _refuse_cut_lines(path: Path, text: str, rows: Sequence[str], mark: str | None) -> None:
    """Refuse rows that end within a line, or two that are joined: NumPy reads some of them."""
    if not text.endswith(("\n", "\r")):
        remedy = "Export or copy it again. If it is whole, end its last line."
        raise InputError(path, "ends within a line: it is cut", remedy)
    count = len(rows[0].split(mark))
    other = next((row for row in rows if len(row.split(mark)) != count), None)
    if other is not None:
        problem = f"has rows of {count} and of {len(other.split(mark))} cells: it is damaged"
        raise InputError(path, problem, "Export or copy the file again.")


def _refuse_odd_decimals(path: Path, cells: Iterable[str], mark: str | None) -> None:
    """Refuse numbers that have lost digits, or been given some, where all have equally many."""
    decimals = re.compile(r"\.(\d+)" if mark == "," else r"[.,](\d+)")
    found = itertools.chain.from_iterable(map(decimals.findall, cells))
    (usual, count), *others = Counter(map(len, found)).most_common() or [(0, 0)]
    odd = sum(times for _, times in others)
    if 0 < odd <= _ODD_FRACTION * count:
        raise InputError(
            path,
            f"{count} of its numbers have {usual} decimals, and {odd} others, such as "
            f"{others[-1][0]}: it is damaged",
            "Export or copy the file again. If you changed numbers, write all decimals.",
        )


def _begins_with_numbers(row: str) -> bool:
    """Whether a line is a row of numbers, not a header, by its first cells."""
    mark = separator_of(row)
    cells = row.split(mark)[:20]
    try:
        return len(cells) > 1 and bool(len(_numbers([(mark or " ").join(cells)], mark)))
    except ValueError:
        return False


def _numbers(
    rows: Sequence[str], mark: str | None, columns: Sequence[int] | None = None
) -> np.ndarray:
    """The cells of rows, or some `columns` of them, NaN where unmeasured."""
    text = _UNMEASURED.sub("nan", "\n".join(rows))
    if mark in (";", "\t"):
        text = text.replace(",", ".")  # beside these separators, a comma is a decimal sign
    if mark:  # empty cells
        text = re.sub(f"(?<![^{mark}\n]) *(?=[{mark}\n]|\\Z)", "nan", text)
    return np.loadtxt(text.splitlines(), delimiter=mark, usecols=columns, ndmin=2)


def _grid_lines(path: Path, values: np.ndarray) -> tuple[np.ndarray, float]:
    """Number of the grid line that each coordinate lies on, and their distance."""
    levels = np.unique(values)
    gaps = np.diff(levels)
    if len(gaps):
        # Rounded text repeats a coordinate with small differences; real steps are larger.
        step = float(np.median(gaps[gaps > _GRID_TOLERANCE * gaps.max()]))
        span = float(np.round((levels[-1] - levels[0]) / step))
        if 1 <= span <= _LARGEST_SIDE:
            step = float(levels[-1] - levels[0]) / span
            index = np.round((values - levels[0]) / step).astype(int)
            if np.abs(values - levels[0] - index * step).max() <= _GRID_TOLERANCE * step:
                return index, step
    raise _scattered(path, len(values))


def _refuse_cut_grid(path: Path, rows: np.ndarray, columns: np.ndarray) -> None:
    """Refuse points in the order of a grid that lack the rest of its last line.

    Points that were not measured may be left out there, too, but then others are elsewhere.
    """
    for lines, places in ((rows, columns), (columns, rows)):
        length = places.max() + 1
        ahead = np.median(np.diff(places)) > 0
        lines = lines if lines[0] <= lines[-1] else lines.max() - lines
        order = lines * length + (places if ahead else length - 1 - places)
        steps = np.diff(order, prepend=-1)
        missing = -(order[-1] + 1) % length
        if (steps > 0).all() and missing > _CUT_TIMES * (steps.max() - 1):
            raise InputError(
                path,
                f"the last line of its grid lacks {missing} of {length} points, and elsewhere at "
                f"most {steps.max() - 1} are missing in a row: it is cut",
                "Export or copy the file again. Write unmeasured points as NaN, if it is whole.",
            )


def _scattered(path: Path, count: int) -> InputError:
    return InputError(
        path,
        f"its {count} points are scattered, or on one line, not on a grid",
        "Grid them in the instrument's software or in Gwyddion, and export the map.",
    )
