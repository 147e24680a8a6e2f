"""Height maps as points in text (.xyz), which must form a grid."""

import logging
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.files import UnreadableError
from gstlib.io.stage import RawMap
from gstlib.io.text import (
    GRID_TOLERANCE,
    HEADER_UNITS,
    SPACING_TOLERANCE,
    UNIT_PATTERN,
    refuse_corner,
    refuse_statements,
    refuse_two_units,
)
from gstlib.io.text_rows import Table, read_table, refuse_odd_decimals

__all__ = ["read_points"]

_log = logging.getLogger(__name__)

# Names of the columns of points with their units, as in x[mm], Y (µm) or z_um.
_UNIT_OF_COLUMN = re.compile(
    rf"(?<![^\W_])([xyzXYZ])[^\S\n]*[\[(_/ ]\s*({UNIT_PATTERN})(?![^\W_])"
)
# If points fill a smaller share of their grid, they are scattered, or one of them is far off.
_LEAST_FILLED = 0.25
_LARGEST_SIDE = 1 << 16
# A last line that lacks more points than so many times the longest row of unmeasured ones is cut.
_CUT_TIMES = 2


def read_points(
    path: Path, unit: str | None = None, config_step: float | None = None
) -> RawMap:
    """Read points on a grid, as a reader of `gstlib.io.scans`.

    `unit` is from the config. Numbers of points must agree with the spacing of the config in this
    unit, `config_step`.
    """
    table = read_table(path)
    refuse_corner(table)
    if not table.is_ended:
        raise UnreadableError(
            "ends within a line: it is cut",
            "Export or copy it again. If it is whole, end its last line.",
        )
    order, units = _columns_of_points(table, unit)
    points = table.numbers[:, order]
    for n in order:
        cells = (row.split(table.mark)[n] for row in table.rows)
        refuse_odd_decimals(cells, table.mark)
    length = None
    if units:
        length = units["z"]
        lateral = np.array([units["x"], units["y"]])
        points[:, :2] *= lateral / length
    # A point without x or y has no position. A point without z is unmeasured.
    has_place = np.isfinite(points[:, :2]).all(axis=1)
    points = points[has_place]
    columns, dx = _grid_lines(points[:, 0])
    rows, dy = _grid_lines(points[:, 1])
    ny, nx = int(rows.max()) + 1, int(columns.max()) + 1
    places = rows * nx + columns
    are_distinct = len(np.unique(places)) == len(points)
    if not are_distinct or len(points) < _LEAST_FILLED * ny * nx:
        raise _scattered(len(points))
    _refuse_cut_grid(rows, columns)
    if length is None:
        _mind_point_numbers(path, points[:, :2], (dx, dy), config_step)
    heights = np.full((ny, nx), np.nan)
    heights[rows, columns] = points[:, 2]
    refuse_two_units(heights, (dy, dx))
    return heights, (dy, dx), length, {}


def _columns_of_points(
    table: Table, unit: str | None
) -> tuple[list[int], dict[str, float] | None]:
    """The columns of x, y and z, and their units (mm), if the header contains them."""
    header = [line for line in table.header if line]
    units: dict[str, float] = {}
    for letter, symbol in _UNIT_OF_COLUMN.findall("\n".join(header)):
        units.setdefault(letter.lower(), HEADER_UNITS[symbol])
    if len(units) < 3:
        refuse_statements(header, unit)
    last = header[-1].strip("# ") if header else ""
    names = table.names or re.split(r"[\s,;]+", last)
    letters = [name.strip("# ")[:1].lower() for name in names]
    if len(letters) != table.numbers.shape[1]:
        letters = []
    without_names = [] if table.names else [[*units], [*"xyz"]]
    for each in (letters, *without_names):
        if {*"xyz"} <= {*each}:
            order = [each.index(letter) for letter in "xyz"]
            return order, units if len(units) == 3 else None
    raise UnreadableError(
        f"names its columns {', '.join(names):.60}, in which x, y and z are not clear",
        "Name them x, y and z, or delete the line.",
    )


def _mind_point_numbers(
    path: Path, places: np.ndarray, steps: Sequence[float], config_step: float | None
) -> None:
    """Refuse numbers of points instead of lengths, if the config contains their spacing."""
    are_steps_one = {*steps} == {1.0}
    do_start_at_one = {*places.min(axis=0)} <= {0, 1}
    if not (are_steps_one and do_start_at_one) or (places % 1).any():
        return
    numbered = "its x and y are whole numbers, 1 apart, like numbers of points"
    if config_step is None:
        message = "%s: %s. They are read as lengths in scans.unit. If they are not, multiply them"
        _log.warning(message, path, numbered)
    elif abs(config_step - 1) > SPACING_TOLERANCE:
        problem = f"{numbered}, but scans.spacing_um is {config_step:g} in scans.unit"
        remedy = "Multiply them by the spacing, or save the heights as a matrix (.csv)."
        raise UnreadableError(
            problem, f"{remedy} If they are lengths, correct scans.spacing_um."
        )


def _grid_lines(values: np.ndarray) -> tuple[np.ndarray, float]:
    """Number of the grid line of each coordinate, and the distance of the lines."""
    levels = np.unique(values)
    gaps = np.diff(levels)
    if len(gaps):
        # Rounded text repeats a coordinate with small differences. Real steps are larger.
        real = gaps[gaps > GRID_TOLERANCE * gaps.max()]
        extent = float(levels[-1] - levels[0])
        span = float(np.round(extent / np.median(real)))
        if 1 <= span <= _LARGEST_SIDE:
            step = extent / span
            places = values - levels[0]
            index = np.round(places / step).astype(int)
            errors = np.abs(places - index * step)
            if errors.max() <= GRID_TOLERANCE * step:
                return index, step
    raise _scattered(len(values))


def _refuse_cut_grid(rows: np.ndarray, columns: np.ndarray) -> None:
    """Refuse points in the order of a grid that lack the rest of its last line.

    Points that were not measured may be left out there, too, but then others are elsewhere.
    """
    for lines, places in ((rows, columns), (columns, rows)):
        length = places.max() + 1
        ahead = np.median(np.diff(places)) > 0
        if lines[0] > lines[-1]:
            lines = lines.max() - lines
        order = lines * length + (places if ahead else length - 1 - places)
        steps = np.diff(order, prepend=-1)
        most_elsewhere = steps.max() - 1
        missing = -(order[-1] + 1) % length
        if (steps > 0).all() and missing > _CUT_TIMES * most_elsewhere:
            raise UnreadableError(
                f"the last line of its grid lacks {missing} of {length} points, and elsewhere at "
                f"most {most_elsewhere} are missing in a row: it is cut",
                "Export or copy the file again. Write unmeasured points as NaN, if it is whole.",
            )


def _scattered(count: int) -> InputError:
    return UnreadableError(
        f"its {count} points are scattered, or on one line, not on a grid",
        "Grid them in the instrument's software or in Gwyddion, and export the map.",
    )
