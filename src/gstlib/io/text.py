"""Height maps in text: matrices (.csv, .txt, .asc), a row of the map a line, and points (.xyz).

Cells are read strictly: a row of another length, or a word among the numbers, is a damaged file.
Of headers, only that of Gwyddion's matrices is understood; others leave unit and spacing to the
config.
"""

import re
from pathlib import Path

import numpy as np

from gstlib.errors import InputError

__all__ = ["SCAN_UNITS", "read_matrix", "read_points", "separator_of"]

# Length of each unit in mm.
SCAN_UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}

# Cells, in lower case, that stand for an unmeasured point.
_UNMEASURED = {"", "nan", "bad", "---"}
# Coordinates in text are rounded: a point belongs to a grid if within this share of a step.
_GRID_TOLERANCE = 0.05
# Points that fill a smaller share of their grid are scattered, or one of them is far off.
_LEAST_FILLED = 0.25
_LARGEST_SIDE = 1 << 16


def read_matrix(
    path: Path,
) -> tuple[np.ndarray, tuple[float, float] | None, float | None, dict[str, str]]:
    """Read a matrix of heights, as a reader of `gstlib.io.scans`."""
    header, heights = _read_rows(path)
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


def read_points(path: Path) -> tuple[np.ndarray, tuple[float, float], None, dict[str, str]]:
    """Read points on a grid, as a reader of `gstlib.io.scans`."""
    points = _read_rows(path, columns=3)[1]
    # A point without x or y is nowhere; one without z is unmeasured.
    points = points[np.isfinite(points[:, :2]).all(axis=1)]
    columns, dx = _grid_lines(path, points[:, 0])
    rows, dy = _grid_lines(path, points[:, 1])
    heights = np.full((rows.max() + 1, columns.max() + 1), np.nan)
    places = rows * heights.shape[1] + columns
    if not len(np.unique(places)) == len(points) >= _LEAST_FILLED * heights.size:
        raise _scattered(path, len(points))
    heights[rows, columns] = points[:, 2]
    return heights, (dy, dx), None, {}


def separator_of(line: str) -> str | None:
    """Separator of a line's cells, None for blanks.

    >>> [separator_of(line) for line in ("1,5; 2", "1,5\\t2", "1, 2", "1 2")]
    [';', '\\t', ',', None]
    """
    return next((mark for mark in ";\t," if mark in line), None)


def _read_rows(path: Path, columns: int | None = None) -> tuple[str, np.ndarray]:
    """The lines above the first row of numbers, and the cells, or the first `columns`, of all."""
    content = path.read_bytes()
    is_utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    if b"\0" in content and not is_utf_16:
        raise InputError(path, "is no text, though its name says so", "Correct its ending.")
    try:
        text = content.decode("utf-16" if is_utf_16 else "utf-8-sig")
    except UnicodeError:
        text = content.decode("latin-1")
    header: list[str] = []
    table: list[list[float]] = []
    mark, ended = None, True
    for number, whole in enumerate(text.splitlines(), 1):
        line = whole.partition("#")[0].strip(" ")
        if not table:
            mark = separator_of(line)
            # The first cells are enough to tell a header from a row with a word in it.
            if len(_numbers(line, mark, columns or 20) or ()) < 2:
                header.append(whole)
                continue
        if not line:
            continue
        row = _numbers(line, mark, columns)
        if row is None:
            raise InputError(
                path,
                f"line {number} is no row of numbers: {line[:60]!r}",
                "Unmeasured points are empty cells, NaN, BAD or ---; comments begin with '#'.",
            )
        wanted = columns or len(table[0] if table else row)
        if len(row) != wanted:
            raise InputError(
                path,
                f"line {number} has {len(row)} cells, not {wanted}: the file is truncated, or no "
                "such table",
                "Export or copy the file again.",
            )
        table.append(row)
        ended = ended and mark is not None and line.endswith(mark)
    if not table:
        raise InputError(path, "has no row of numbers", "Export the whole topography as text.")
    numbers = np.array(table, dtype=float)
    # A separator at the end of each line makes one empty cell more.
    return "\n".join(header), numbers[:, :-1] if ended and not columns else numbers


def _numbers(line: str, mark: str | None, most: int | None) -> list[float] | None:
    """The first `most` cells of a line as numbers, NaN where unmeasured; None if one is text."""
    if mark in (";", "\t"):
        line = line.replace(",", ".")  # beside these separators, a comma is a decimal sign
    cells = [cell.strip().lower() for cell in line.split(mark)[:most]]
    try:
        if any("_" in cell for cell in cells):  # which Python allows within numbers
            return None
        return [float("nan" if cell in _UNMEASURED else cell) for cell in cells]
    except ValueError:
        return None


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


def _scattered(path: Path, count: int) -> InputError:
    return InputError(
        path,
        f"its {count} points are scattered, or on one line, not on a grid",
        "Grid them in the instrument's software or in Gwyddion, and export the map.",
    )
