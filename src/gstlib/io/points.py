"""Points in text (.xyz: columns x, y, z), on a grid or scattered."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.bounds import bounded
from gstlib.io.height_map import SCAN_UNITS, HeightMap, Unsaid
from gstlib.io.text import cells_of, number, read_text, separator_of
from gstlib.surface import axis_coordinates

__all__ = ["read_points"]

# Coordinates in text are rounded: a point belongs to a grid if within this share of a step.
_GRID_TOLERANCE = 0.05
# Points that fill a smaller share of their grid are scattered, or an edge of it is far off.
_LEAST_FILLED = 0.25
_LARGEST_SIDE = 1 << 16
# Between scattered points nothing is known: ten elements from one to the next are more than enough.
_MOST_ELEMENTS_PER_POINT = 100

_EXPORT = "Export the points as text, one 'x y z' a line; comments begin with '#'."


def read_points(
    path: Path,
    unsaid: Unsaid,
    scatter_spacing: float | None,
    scatter_extent: Sequence[float] | None,
) -> HeightMap:
    """Read points; see `gstlib.io.scans.read_scan`."""
    with bounded(path, path.stat().st_size):
        text = read_text(path)
        lateral, vertical = _units(path, text, unsaid)
        x, y, z = (_load_columns(path, text) * [lateral, lateral, vertical]).T
        grid = _as_grid(x, y)
    if grid is None:
        return _gridded(path, (x, y, z), scatter_spacing, scatter_extent)
    (columns, dx), (rows, dy) = grid
    heights = np.full((rows.max() + 1, columns.max() + 1), np.nan)
    heights[rows, columns] = z
    return HeightMap(heights, (dy, dx))


def _gridded(
    path: Path,
    points: Sequence[np.ndarray],
    spacing: float | None,
    extent: Sequence[float] | None,
) -> HeightMap:
    """Scattered points, interpolated linearly between them."""
    x, y, z = points
    if spacing is None:
        raise InputError(
            path,
            f"its {len(x)} points are scattered, not on a grid",
            "Set scans.scatter_spacing_um in the config to the spacing to grid them with.",
        )
    x0, x1, y0, y1 = extent or (x.min(), x.max(), y.min(), y.max())
    nx, ny = (np.round((end - start) / spacing) for start, end in ((x0, x1), (y0, y1)))
    if not (min(nx, ny) >= 2 and nx * ny <= _MOST_ELEMENTS_PER_POINT * len(x)):
        raise InputError(
            path,
            f"gridding {x1 - x0:.4g} × {y1 - y0:.4g} mm every {spacing:g} mm "
            f"makes {nx:.0f} × {ny:.0f} elements of {len(x)} points",
            "Check scans.unit, scatter_spacing_um and scatter_extent_mm in the config.",
        )
    from scipy.interpolate import griddata
    from scipy.spatial import QhullError

    centres = np.meshgrid(
        axis_coordinates(int(nx), spacing, x0), axis_coordinates(int(ny), spacing, y0)
    )
    try:
        with bounded(path, path.stat().st_size):
            heights = griddata((x, y), z, tuple(centres), method="linear")
    except (QhullError, ValueError) as error:
        raise InputError(
            path,
            f"no surface can be laid through its {len(x)} points "
            f"({str(error).strip().splitlines()[0]})",
            "Points on one line are a profile: export the whole topography.",
        ) from error
    return HeightMap(heights, (spacing, spacing), {"gridded": "linearly, from points"})


def _units(path: Path, text: str, unsaid: Unsaid) -> tuple[float, float]:
    """Lengths in mm of the units of x and y, and of z: Gwyddion writes them into a comment."""
    comments = re.findall(r"^#\s*(Lateral|Value) units:\s*(\S+)", text[:2000], re.MULTILINE)
    said = {name: unit.replace("µ", "u").replace("μ", "u") for name, unit in comments}
    if len(said) < 2:
        return (unsaid.unit_factor(path),) * 2
    unknown = set(said.values()) - set(SCAN_UNITS)
    if unknown:
        raise InputError(
            path, f"its header speaks of the units {sorted(unknown)}", "Export it in metres."
        )
    return SCAN_UNITS[said["Lateral"]], SCAN_UNITS[said["Value"]]


def _load_columns(path: Path, text: str) -> np.ndarray:
    """The first three columns of a text, (points, 3)."""
    mark = separator_of(next((line for _, line in _data_lines(text)), ""))
    if mark in (";", "\t"):
        text = re.sub(r",(?=\d)", ".", text)  # decimal commas
    lines = text.splitlines()
    for delimiter in (None, ",", ";"):
        try:
            points = np.loadtxt(lines, usecols=(0, 1, 2), delimiter=delimiter, ndmin=2)
            break
        except (ValueError, IndexError):
            continue
    else:
        # slower, but it knows unmeasured cells, and the line at fault
        points = np.array([_point(path, n, line, mark) for n, line in _data_lines(text)])
    # A point without x or y is nowhere; one without z is unmeasured.
    points = points[np.isfinite(points[:, :2]).all(axis=1)]
    if len(points) < 4:
        raise InputError(
            path, f"cannot be read as columns x, y, z: it has only {len(points)} points", _EXPORT
        )
    return points


def _data_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines with content, numbered, without their comments."""
    for count, line in enumerate(text.splitlines(), start=1):
        line = line.partition("#")[0]
        if line.strip():
            yield count, line


def _point(path: Path, count: int, line: str, mark: str | None) -> list[float]:
    try:
        x, y, z = (number(cell) for cell in cells_of(line, mark)[:3])
    except ValueError:
        raise InputError(
            path,
            f"cannot be read as columns x, y, z of numbers: line {count} is {line.strip()[:60]!r}",
            _EXPORT,
        ) from None
    return [x, y, z]


def _as_grid(x: np.ndarray, y: np.ndarray):
    """((column of each point, dx), (row of each point, dy)), or None if they are scattered."""
    axes = []
    for values in (x, y):
        levels = np.unique(values)
        gaps = np.diff(levels)
        if not (len(gaps) and np.isfinite(gaps).all()):
            return None
        # Rounded text repeats a coordinate with small differences; real steps are larger.
        step = float(np.median(gaps[gaps > _GRID_TOLERANCE * gaps.max()]))
        span = float(np.round((levels[-1] - levels[0]) / step))
        if not 1 <= span <= _LARGEST_SIDE:
            return None
        step = float(levels[-1] - levels[0]) / span
        index = np.round((values - levels[0]) / step).astype(int)
        if not np.abs(values - levels[0] - index * step).max() <= _GRID_TOLERANCE * step:
            return None
        axes.append((index, step))
    (columns, _), (rows, _) = axes
    width, height = columns.max() + 1, rows.max() + 1
    if len(x) < _LEAST_FILLED * width * height:
        return None
    places = rows.astype(np.int64) * width + columns
    if len(np.unique(places)) < len(places):
        return None
    return axes
