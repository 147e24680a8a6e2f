"""Height maps in text: matrices (.csv, .txt, .asc), a row of the map a line.

`gstlib.io.text_rows` reads the rows. Three headers are understood: Gwyddion's header of a matrix,
the header of an ESRI grid, and units beside the names of the columns x, y and z. Another header
with a unit or a size is refused. If a header is missing, unit and spacing come from the config, and
from coordinates in the first row and column.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from gstlib.io.files import UnreadableError
from gstlib.io.stage import RawMap
from gstlib.io.text_rows import (
    NUMBER,
    UNMEASURED_CELLS,
    Table,
    read_table,
    refuse_odd_decimals,
)

__all__ = [
    "GRID_TOLERANCE",
    "HEADER_UNITS",
    "SCAN_UNITS",
    "SPACING_TOLERANCE",
    "UNIT_PATTERN",
    "read_matrix",
    "refuse_corner",
    "refuse_statements",
    "refuse_two_units",
]

# Length of each unit in mm. Headers may also have others.
SCAN_UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}
HEADER_UNITS = SCAN_UNITS | {"cm": 10.0, "pm": 1e-9, "µm": 1e-3, "μm": 1e-3, "Å": 1e-7}
UNIT_PATTERN = "|".join(sorted(HEADER_UNITS, key=len, reverse=True))

# Lines above an ESRI grid. Others contain its corner. A number marks its unmeasured cells.
_ESRI = re.compile(
    rf"^\s*(ncols|nrows|cellsize|dx|dy|nodata_value)\s+({NUMBER}|nan)\s*$",
    re.IGNORECASE | re.MULTILINE,
)
_ESRI_UNMEASURED = -9999.0
_GWYDDION = re.compile(
    r"^# *(Width|Height|Value)(?: units)?: *+((?:\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?)?) *"
    rf"({UNIT_PATTERN})\s*$",
    re.MULTILINE,
)
# A line with a unit or a size, in any language, as far as its words show. "um" is also a word.
_UNIT_STATED = re.compile(
    rf"(?:[\d\[({{<:;|=/,_]\s*|\bin\s+)({UNIT_PATTERN}|inch(?:es)?|mils?|px)(?![^\W_])"
    r"|(?:^|\s)(nm|mm|µm|μm|Å)(?![^\W_])|(?:^|\s)(um)\s*$"
)
_TIME = re.compile(r"\d:\d\d(?::\d\d)?\s*[ap]m\b", re.IGNORECASE)
_SIZE_STATED = re.compile(
    r"\b(?:unit(?!ed)|einheit|unid|eenhe|enhet|jednot|ncols|nrows"
    r"|micro(?:n|met)|nanomet|millimet|mikromet)"
    r"|(?:spac|pitch|pixel|cell|step|scal|échel|factor|fakt|facteur|fatt|schritt|abstand|incr"
    r"|[xy]inc|\bd[xy]\b|resol|risol|auflös|\bpas\b|\bpass?o\b)[^\d\n]*\d"
    r"|(?:width|height|size|length|breite|höhe|länge|größe|largeur|hauteur|taille|anch|altura"
    r"|alto|tama|largh|altezz|dimens)[^\d\n:=]*[:=]\s*[-+]?[.\d]",
    re.IGNORECASE,
)

# Coordinates in text are rounded: a point belongs to a grid if within this share of a step.
GRID_TOLERANCE = 0.05
# Lines that are looked at to see whether one is unlike the others.
_SAMPLED = 200
# ASSUME: Coordinates in a matrix of heights. A first row or column of five or more evenly spaced
# numbers contains coordinates, if most other rows or columns are uneven. If rounding makes the
# steps uneven, it needs 20 numbers or more. Its distance from the second line must then be three
# times the distance from the second to the third. If it only rises, ten times this distance is
# needed, and the file is refused. Reason: Measured profiles are not so even.
_FEWEST_TICKS, _MORE_TICKS = 5, 20
_ROUNDED, _APART, _FAR_APART = 0.5, 3, 10
# On a smooth tilted map all lines are nearly even. Coordinates are then far more even than others.
_FAR_MORE_EVEN, _EVEN = 0.1, 1e-6
# Coordinates and a spacing in the config that differ by more contradict each other.
SPACING_TOLERANCE = 0.01
# ASSUME: Different units of heights and coordinates. If half of the neighbouring heights differ by
# more than ten steps of the grid, heights and coordinates have different units. Reason: No stone is
# so steep.
_STEEPEST = 10.0
# Columns of fewer points belong to a table, such as x, y, z and intensity.
_MOST_COLUMNS, _LONG = 6, 20


def read_matrix(
    path: Path, unit: str | None = None, config_step: float | None = None
) -> RawMap:
    """Read a matrix of heights, as a reader of `gstlib.io.scans`.

    `unit` is from the config. Coordinates must agree with the spacing of the config in this unit,
    `config_step`.
    """
    table = read_table(path)
    if table.is_split:
        raise UnreadableError(
            "blank lines or comments divide its rows into blocks, like several maps",
            "Keep one map in each file.",
        )
    numbers = table.numbers
    header = "\n".join(table.header)
    raw = _esri_grid(header, numbers) or _gwyddion_map(header, numbers)
    if raw is not None:  # and nothing but heights follows the header
        refuse_odd_decimals(table.rows, table.mark)
        refuse_corner(table)
        return raw
    ny, nx = numbers.shape
    is_long = nx <= _MOST_COLUMNS and ny > _LONG * nx
    if nx < 3 or nx == 3 < ny or is_long:
        raise UnreadableError(
            f"has {nx} columns and {ny} rows, as profiles and points have, not a map",
            "If it holds points x, y, z, change its ending to .xyz; else export the whole map.",
        )
    refuse_statements([*table.header, table.corner], unit)
    return *_without_coordinates(table, config_step), None, {}


def refuse_statements(lines: Iterable[str], unit: str | None) -> None:
    """Refuse lines with a unit or a size in words that are not understood.

    A line without numbers that only repeats the `unit` of the config is accepted.
    """
    for line in lines:
        matches = _UNIT_STATED.finditer(_TIME.sub("", line))
        symbols = [match[match.lastindex or 0] for match in matches]
        lengths = {HEADER_UNITS.get(symbol) for symbol in symbols}
        agrees = unit is not None and lengths == {SCAN_UNITS[unit]}
        if agrees and not re.search(r"\d", line):
            continue
        if symbols or _SIZE_STATED.search(line):
            raise UnreadableError(
                f"its line {line.strip()!r:.80} states a unit or a size that is not understood",
                "Export the scan with an English header, or in a format that states its unit and "
                "spacing. If the line only repeats scans.unit and scans.spacing_um, delete it.",
            )


def _without_coordinates(
    table: Table, config_step: float | None
) -> tuple[np.ndarray, tuple[float, float] | None]:
    """Heights without coordinates in their first row and column, and the steps (y, x) of both.

    Rows and columns are then in the order of increasing coordinates, as for points. The steps are
    None unless both are known. Numbers of rows and columns have no steps.
    """
    numbers = table.numbers
    ticks = _ticks(numbers.T), _ticks(numbers)
    has_y, has_x = (each is not None for each in ticks)
    if not (has_x and has_y):
        refuse_corner(table)
        # it belongs to the only coordinates
        ticks = numbers[:, 0] if has_y else None, numbers[0] if has_x else None
    heights = numbers[int(has_x) :, int(has_y) :]
    rows = table.rows[int(has_x) :]
    if has_y:
        rows = [row.split(table.mark, 1)[1] for row in rows]
    refuse_odd_decimals(rows, table.mark)
    rest = (heights, heights.T) if has_x or has_y else ()
    if any(_ticks(lines) is not None for lines in rest):
        raise UnreadableError(
            "has two rows or columns of coordinates in one direction",
            "Keep one of them, or none.",
        )
    steps = []
    for axis, each in enumerate(ticks):
        if each is None:
            continue
        step, is_length = _step_of(each, config_step)
        if is_length:
            steps.append(abs(step))
        if step < 0:
            heights = np.flip(heights, axis)
    if len(steps) < 2:
        return heights, None
    refuse_two_units(heights, steps)
    return heights, (steps[0], steps[1])


def _step_of(ticks: np.ndarray, config_step: float | None) -> tuple[float, bool]:
    """The step of coordinates, and whether it is a length: numbers of rows or columns are not."""
    if not _unevenness(ticks[None]) <= _ROUNDED:
        raise UnreadableError(
            f"has coordinates in one direction only, and {ticks[0]:g} in their corner",
            "Delete them, or give them in both directions.",
        )
    step = float(ticks[-1] - ticks[0]) / (len(ticks) - 1)
    is_length = abs(step) != 1 or ticks.min() not in (0, 1)
    apart = np.inf if config_step is None else abs(abs(step) / config_step - 1)
    if is_length and SPACING_TOLERANCE < apart < np.inf:
        raise UnreadableError(
            f"its coordinates are {abs(step):g} apart, but scans.spacing_um is "
            f"{config_step:g}, in scans.unit",
            "Correct scans.unit or scans.spacing_um, or delete the coordinates.",
        )
    return step, is_length


def refuse_corner(table: Table) -> None:
    """Refuse a word in the first cell, unless coordinates are on both sides of it."""
    if table.corner:
        raise UnreadableError(
            f"its first cell is {table.corner!r:.20}, beside heights", UNMEASURED_CELLS
        )


def _ticks(lines: np.ndarray) -> np.ndarray | None:
    """The coordinates in the first of some lines, without the corner; None if it has heights."""
    first, others = lines[0, 1:], lines[1:, 1:]
    if len(first) < _FEWEST_TICKS or len(others) < 2 or not np.isfinite(first).all():
        return None
    sample = others[:: max(1, len(others) // _SAMPLED)]
    (own,) = _unevenness(first[None])
    uneven = np.median(_unevenness(sample))
    near, next_ = _median(first - others[0]), _median(others[0] - others[1])
    is_long = len(first) >= _MORE_TICKS
    is_outstanding = is_long and own < _FAR_MORE_EVEN * uneven and uneven > _EVEN
    if uneven <= _ROUNDED and not is_outstanding:  # a plane, or heights in few steps
        return None
    if own <= GRID_TOLERANCE or (is_long and own <= _ROUNDED and near > _APART * next_):
        return first
    steps = np.diff(first)
    is_rising = np.all(steps > 0) or np.all(steps < 0)
    if is_long and is_rising and near > _FAR_APART * next_:
        raise UnreadableError(
            f"its first row or column rises or falls from {first[0]:g} to {first[-1]:g} in uneven "
            "steps, far from all others, as coordinates do",
            "Grid the points evenly, and export the map again.",
        )
    return None


def _median(values: np.ndarray) -> float:
    """The median size of finite values; infinite if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.median(np.abs(finite))) if finite.size else np.inf


def _unevenness(lines: np.ndarray) -> np.ndarray:
    """How far each line departs from even steps between its ends, in such steps."""
    count = lines.shape[1] - 1
    steps = (lines[:, -1:] - lines[:, :1]) / count
    with np.errstate(divide="ignore", invalid="ignore"):
        places = (lines - lines[:, :1]) / steps
        departures = np.abs(places - np.arange(count + 1)).max(axis=1)
    return np.where(np.isfinite(departures), departures, np.inf)


def refuse_two_units(heights: np.ndarray, steps: Sequence[float]) -> None:
    """Refuse heights so steep that their unit must differ from the unit of the coordinates."""
    with np.errstate(invalid="ignore"):  # of two infinite heights
        steepness = min(
            _median(np.diff(heights, axis=axis)) / step
            for axis, step in enumerate(steps)
        )
    if _STEEPEST < steepness < np.inf:
        raise UnreadableError(
            f"half of its heights differ from the next by more than {steepness:.3g} times the "
            "distance of the points: coordinates and heights have different units",
            "Export all in one unit; for points, a first line such as x[mm] y[mm] z[um] states "
            "each.",
        )


def _gwyddion_map(header: str, heights: np.ndarray) -> RawMap | None:
    """Heights, spacing and unit, if the header is that of Gwyddion."""
    stated = {
        name: float(number.replace(",", ".") or 1) * HEADER_UNITS[symbol]
        for name, number, symbol in _GWYDDION.findall(header)
    }
    if len(stated) < 3:
        return None
    ny, nx = heights.shape
    length = stated["Value"]
    steps = stated["Height"] / ny / length, stated["Width"] / nx / length
    return heights, steps, length, {}


def _esri_grid(header: str, heights: np.ndarray) -> RawMap | None:
    """Heights and spacing of an ESRI ASCII grid, whose first row has the highest y."""
    stated = {
        name.lower(): float(number.replace(",", "."))
        for name, number in _ESRI.findall(header)
    }
    if not {"ncols", "nrows"} <= stated.keys():
        return None
    dy, dx = (stated.get(name, stated.get("cellsize")) for name in ("dy", "dx"))
    if dy is None or dx is None:
        raise UnreadableError(
            "the header of an ESRI grid does not contain a number for 'cellsize'",
            "Export the grid again.",
        )
    if heights.shape != (stated["nrows"], stated["ncols"]):
        ny, nx = heights.shape
        raise UnreadableError(
            f"contains {ny} rows of {nx} heights, but its header states {stated['nrows']:g} of "
            f"{stated['ncols']:g}",
            "Export it again, with one row of the grid a line.",
        )
    heights[heights == stated.get("nodata_value", _ESRI_UNMEASURED)] = np.nan
    refuse_two_units(heights, (dy, dx))
    return heights[::-1], (dy, dx), None, {}
