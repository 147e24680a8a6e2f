"""Matrices of heights in text (.csv, .txt, .asc): one row of the map a line.

The cells are read here, strictly: a row that is too short, or a word among the numbers, is a
damaged file. What a header says (as Gwyddion, SPIP, Wyko, Nova and Attocube write them) is for
SurfaceTopography to understand; without one, unit and spacing have to be in the config.
"""

import io
from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.bounds import bounded
from gstlib.io.height_map import HeightMap, Unsaid
from gstlib.io.text import cells_of, mentioned_units, number, read_text, separator_of, split_header

__all__ = ["read_matrix"]

# Fewer numbers may be evenly spaced by chance; coordinates are so within rounding, in steps.
_FEWEST_COORDINATES, _COORDINATE_TOLERANCE = 10, 0.05

_EXPORT = "Export the whole topography as a matrix, or as .plu, .plux, .sur, .x3p or .al3d."


def read_matrix(path: Path, unsaid: Unsaid) -> HeightMap:
    """Read a matrix of heights; see `gstlib.io.scans.read_scan`."""
    with bounded(path, path.stat().st_size):
        header, rows = split_header(path, read_text(path))
        heights = _cells(path, rows)
        _check_coordinates(path, header, heights)
    ny, nx = heights.shape
    if nx < 3:
        raise InputError(path, f"holds a profile ({nx} columns of numbers), not a map", _EXPORT)
    said = _meaning(path, header, heights.shape) if header else None
    if nx == 3 and ny > 3 and (said is None or said[1] is None):
        raise InputError(
            path,
            f"has 3 columns and {ny} rows, as points x, y, z have, not a map",
            "If it holds points, change its ending to .xyz.",
        )
    if said is None:
        _check_units(path, header, unsaid)
        return HeightMap(heights * unsaid.unit_factor(path), unsaid.spacing(path))
    unit, sizes, scale = said
    factor = unsaid.unit_factor(path) if unit is None else unit
    if sizes is None:
        spacing = unsaid.spacing(path)
    else:
        spacing = (sizes[1] * factor / ny, sizes[0] * factor / nx)
    return HeightMap(heights * scale * factor, spacing)


def _cells(path: Path, rows: list[tuple[int, str]]) -> np.ndarray:
    """The matrix (rows, columns) in the file's own unit, NaN where unmeasured."""
    if not rows:
        raise InputError(path, "cannot be read as a matrix: it has no row of numbers", _EXPORT)
    mark = separator_of(rows[0][1])
    heights, width = [], None
    for count, line in rows:
        cells = cells_of(line, mark)
        try:
            heights.append(np.array([number(cell) for cell in cells]))
        except ValueError:
            raise InputError(
                path,
                f"line {count} is no row of numbers: {line.strip()[:60]!r}",
                "Unmeasured points are empty cells, NaN, BAD or ---.",
            ) from None
        width = width or len(cells)
        if len(cells) != width:
            raise InputError(
                path,
                f"line {count} has {len(cells)} cells, the first row {width}: it is truncated, "
                "or no matrix",
                "Export the scan again.",
            )
    matrix = np.array(heights)
    # a separator at the end of each line makes one empty cell more
    ended = mark is not None and all(line.rstrip(" ").endswith(mark) for _, line in rows)
    return matrix[:, :-1] if ended else matrix


def _check_coordinates(path: Path, header: list[str], heights: np.ndarray) -> None:
    """Refuse a matrix with its coordinates in a row above it and a column beside it."""
    row, column = heights[0, 1:], heights[1:, 0]
    if header and not _is_even(row):
        row, column = _numbers_above(header[-1], heights.shape[1]), heights[:, 0]
    inner = heights[1:, 1:]
    if (
        _is_even(row)
        and _is_even(column)
        # the rows of an ideal plane are even, all of them
        and not any(_is_even(line) for lines in (inner, inner.T) for line in lines)
    ):
        raise InputError(
            path,
            "the numbers on top of its columns and those of its first column go up or down in "
            "equal steps, as coordinates do, not heights",
            "Export the heights alone, or delete that row and that column.",
        )


def _numbers_above(line: str, width: int) -> np.ndarray:
    """Numbers of a header's line over columns of the matrix, from the second on, if it has them."""
    try:
        return np.array([number(cell) for cell in cells_of(line, separator_of(line))[1:width]])
    except ValueError:
        return np.array([])


def _is_even(values: np.ndarray) -> bool:
    if len(values) < _FEWEST_COORDINATES:
        return False
    step = (values[-1] - values[0]) / (len(values) - 1)
    deviation = np.abs(values - values[0] - step * np.arange(len(values)))
    return bool(step != 0 and deviation.max() <= _COORDINATE_TOLERANCE * abs(step))


def _meaning(path: Path, header: list[str], shape: tuple[int, int]):
    """(length of the unit in mm or None, (size x, size y) or None, scale of the heights)."""
    from SurfaceTopography.IO import open_topography
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    # the same header over a matrix of the same shape; what its cells are has been seen above
    row = " ".join(["0"] * shape[1]) + "\n"
    text = "\n".join(header) + "\n" + row * shape[0]
    with bounded(path, len(text)):
        try:
            channel = open_topography(io.StringIO(text), format="asc").default_channel
            unit, sizes = channel.unit, channel.physical_sizes
            factor = None if unit is None else get_unit_conversion_factor(unit, "mm")
            if sizes is not None and len(sizes) < 2:
                raise ValueError("it says the size along one side only")
        except MemoryError:
            raise
        except Exception as error:  # the reader raises whatever its parsing raises
            raise InputError(
                path,
                f"its header cannot be understood ({type(error).__name__}: {error})",
                "Remove the header and set scans.unit and scans.spacing_um in the config.",
            ) from error
    if unit is None and sizes is None:
        return None
    scale = channel.height_scale_factor
    return factor, sizes, 1.0 if scale is None else scale


def _check_units(path: Path, header: list[str], unsaid: Unsaid) -> None:
    """A header that nobody understands must not contradict the config."""
    other = mentioned_units(header) - {unsaid.unit}
    if other and unsaid.unit is not None:
        raise InputError(
            path,
            f"its header speaks of {sorted(other)}, but scans.unit in the config is {unsaid.unit}",
            "Correct scans.unit, or remove the header if it is about something else.",
        )
