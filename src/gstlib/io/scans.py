"""Height maps as the instrument wrote them, read through SurfaceTopography, as surfaces in mm.

SurfaceTopography gives heights as [ix, iy] in a unit that differs per file; here they become rows
along y, columns along x, in the order of the file, in mm. Text files of points (.xyz) are read
here, since a scattered cloud has to be gridded first. SurfaceTopography: Röttger et al. 2022, Surf.
Topogr.: Metrol. Prop. 10:035032.
"""

import math
import struct
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.surface import axis_coordinates, make_surface, spacing_of

__all__ = ["SCAN_UNITS", "check_size", "cut_scan", "read_scan"]

# Length of each unit in mm.
SCAN_UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}

# What a profilometer of any kind can have measured (mm); outside it the unit is wrong.
_LARGEST_FIELD, _LARGEST_RANGE = 50.0, 10.0
_SMALLEST_SPACING, _LARGEST_SPACING = 1e-6, 0.5
# A scan may differ from the study's size by this share: pixel sizes are rounded (512 × 1.66 µm is
# 849.92 µm), and a row more or less does no harm.
_SIZE_TOLERANCE = 0.01
# Spacings come from float32 numbers or text; digits beyond these are noise.
_SPACING_DIGITS = 7
# Coordinates in text are rounded: a point belongs to a grid if within this share of a step.
_GRID_TOLERANCE = 0.05

# A .plu has no magic number: more points a side than this and it is something else.
_LARGEST_PLU_SIDE = 1 << 16

_MEASURE_AGAIN = "Export or copy the scan again."


def read_scan(
    path: str | Path,
    *,
    unit: str | None = None,
    scatter_spacing_mm: float | None = None,
    scatter_extent_mm: Sequence[float] | None = None,
) -> xr.DataArray:
    """Read a height map from an instrument's file.

    Parameters
    ----------
    path : str or Path
        Any map that SurfaceTopography reads (.plu, .plux, .al3d, .sur, .opd, ...), or a text file
        of points .xyz (columns x, y, z), on a grid or scattered.
    unit : {"m", "mm", "um", "nm"}, optional
        Unit of files that do not name theirs; of no effect on the others.
    scatter_spacing_mm : float, optional
        Element size on which scattered points are interpolated (linearly, in their Delaunay
        triangulation).
    scatter_extent_mm : (x0, x1, y0, y1), optional
        Rectangle to grid, in the file's own coordinates; without it, the points' bounding box.

    Returns
    -------
    (ny, nx) xarray.DataArray
        Surface in mm with rows and columns as in the file, NaN where unmeasured, beginning at
        (0, 0); attributes (text): ``file`` and what the file tells of the instrument.

    Raises
    ------
    InputError
        The file is missing, empty, truncated, unreadable or no map; its unit, its spacing or the
        spacing to grid it with is not known; its size is absurd; nothing in it is measured.
    """
    path = Path(path)
    if unit is not None and unit not in SCAN_UNITS:
        raise InputError(path, f"unknown scan unit {unit!r}", f"Use one of {list(SCAN_UNITS)}.")
    if not path.is_file():
        raise InputError(
            path, "no such file", "Correct the name in the patch table, or the folder."
        )
    if path.stat().st_size == 0:
        raise InputError(path, "the file is empty", _MEASURE_AGAIN)
    if path.suffix.lower() == ".xyz":
        heights, spacing, attrs = _read_points(
            path, _unit_factor(path, unit), scatter_spacing_mm, scatter_extent_mm
        )
    else:
        heights, spacing, attrs = _read_instrument_file(path, unit)
    spacing = tuple(float(f"{step:.{_SPACING_DIGITS}g}") for step in spacing)
    _check_plausible(path, heights, spacing)
    return make_surface(heights, spacing, long_name="height as measured", file=path.name, **attrs)


def cut_scan(scan: xr.DataArray, centre: Sequence[float], size_mm: float) -> xr.DataArray:
    """A square piece of a scan.

    Parameters
    ----------
    scan : (ny, nx) xarray.DataArray
        The whole scan, mm.
    centre : (x, y)
        Centre of the piece in mm, from the scan's centre along its columns and rows.
    size_mm : float
        Side of the piece; it is cut at whole elements.

    Returns
    -------
    (n, m) xarray.DataArray
        The piece, beginning at (0, 0).

    Raises
    ------
    InputError
        The piece sticks out of the scan.
    """
    slices, beyond = [], 0.0
    for length, step, middle in zip(
        scan.shape, spacing_of(scan), (centre[1], centre[0]), strict=True
    ):
        count = round(size_mm / step)
        # Half an element is rounded up always, so that pieces side by side stay side by side.
        first = math.floor(length / 2 + middle / step - count / 2 + 0.5 + 1e-9)
        beyond = max(beyond, -first * step, (first + count - length) * step)
        slices.append(slice(first, first + count))
    if beyond > 0:
        height, width = (n * step for n, step in zip(scan.shape, spacing_of(scan), strict=True))
        raise InputError(
            scan.attrs.get("file", "scan"),
            f"a piece of {size_mm:g} mm around x = {centre[0]:g}, y = {centre[1]:g} mm sticks out "
            f"by {beyond:.4g} mm of the scan of {width:.4g} × {height:.4g} mm",
            "Correct crop_x_mm and crop_y_mm in the patch table: they count from its centre.",
        )
    return make_surface(scan.values[tuple(slices)], spacing_of(scan), **_attrs(scan))


def check_size(scan: xr.DataArray, size_mm: float) -> None:
    """Refuse a scan that is not a square of `size_mm` (mm), within one per cent.

    Raises
    ------
    InputError
        Names the scan's file, its size and the size that the study wants.
    """
    height, width = (n * step for n, step in zip(scan.shape, spacing_of(scan), strict=True))
    if max(abs(height - size_mm), abs(width - size_mm)) > _SIZE_TOLERANCE * size_mm:
        raise InputError(
            scan.attrs.get("file", "scan"),
            f"the scan is {width:.4g} × {height:.4g} mm ({scan.shape[1]} × {scan.shape[0]} "
            f"points), but the study's patches are {size_mm:g} × {size_mm:g} mm",
            "Correct scans.size_mm in the config, or have a piece of the scan cut: give crop_x_mm "
            "and crop_y_mm in the patch table.",
        )


def _attrs(scan: xr.DataArray) -> dict:
    return {name: value for name, value in scan.attrs.items() if name != "units"}


def _unit_factor(path: Path, unit: str | None) -> float:
    if unit is None:
        raise InputError(
            path,
            "the file does not say its unit of length",
            f"Set scans.unit in the config to one of {list(SCAN_UNITS)}.",
        )
    return SCAN_UNITS[unit]


def _check_plausible(path: Path, heights: np.ndarray, spacing: Sequence[float]) -> None:
    if not np.isfinite(heights).any():
        raise InputError(path, "not one point is measured", "Measure the patch again.")
    field = max(n * step for n, step in zip(heights.shape, spacing, strict=True))
    extent = float(np.nanmax(heights) - np.nanmin(heights))
    remedy = "Check scans.unit in the config, and the instrument's export."
    if field > _LARGEST_FIELD or max(spacing) > _LARGEST_SPACING:
        raise InputError(
            path,
            f"a field of {field:.4g} mm with points every {max(spacing):.4g} mm is too large "
            "for a surface scan: its unit is probably wrong",
            remedy,
        )
    if min(spacing) < _SMALLEST_SPACING:
        raise InputError(
            path,
            f"points every {min(spacing):.4g} mm are too close for a surface scan: its unit is "
            "probably wrong",
            remedy,
        )
    if extent > _LARGEST_RANGE:
        raise InputError(
            path,
            f"heights range over {extent:.4g} mm, too much for a surface scan: its unit is wrong, "
            "or unmeasured points are stored as a number",
            remedy,
        )


def _read_instrument_file(path: Path, unit: str | None) -> tuple[np.ndarray, tuple, dict]:
    """Heights (ny, nx) mm, spacing (dy, dx) mm and metadata through SurfaceTopography."""
    from SurfaceTopography.IO import open_topography
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    is_plu = path.suffix.lower() == ".plu"
    if is_plu:
        _check_plu(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the many readers that it tries
            # .plu has no magic number, so it is the one format that must not be guessed.
            reader = open_topography(str(path), format="plu" if is_plu else None)
            channel = reader.default_channel
            named = channel.unit is not None
    except Exception as error:  # the readers raise whatever their parsers raise
        first_line = str(error).strip().splitlines()[:1]
        raise InputError(
            path,
            f"cannot be read as a height map ({type(error).__name__}: {' '.join(first_line)})",
            "Export the scan in the instrument's own format (.plu, .plux, .al3d, .sur, ...).",
        ) from error
    if channel.dim != 2:
        raise InputError(path, "holds a profile, not a map", "Export the whole topography.")
    if channel.physical_sizes is None:
        raise InputError(
            path,
            "the file does not say the spacing of its points",
            "Export the scan in a format that does (.plu, .plux, .al3d, .sur, .xyz, ...).",
        )
    if not named:
        _unit_factor(path, unit)
    try:
        topography = channel.topography() if named else channel.topography(unit=unit)
        heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=float), np.nan)
    except Exception as error:
        raise InputError(
            path,
            f"its heights cannot be read ({type(error).__name__}: {error}): the file is truncated "
            "or damaged",
            _MEASURE_AGAIN,
        ) from error
    factor = get_unit_conversion_factor(topography.unit, "mm")
    nx, ny = heights.shape
    size_x, size_y = topography.physical_sizes
    spacing = (float(size_y) * factor / ny, float(size_x) * factor / nx)
    return heights.T * factor, spacing, _metadata(topography.info)


def _metadata(info: dict) -> dict[str, str]:
    """What the file tells of the instrument, as text."""
    instrument = info.get("instrument") or {}
    raw = info.get("raw_metadata") or {}
    configuration = raw.get("measurement_configuration") if isinstance(raw, dict) else None
    found = {
        "instrument": instrument.get("name"),
        "vendor": instrument.get("vendor"),
        "objective": (configuration or {}).get("objective"),
        "acquired": info.get("acquisition_time"),
    }
    return {name: str(value) for name, value in found.items() if value is not None}


def _check_plu(path: Path) -> None:
    """Hold a .plu file against the size of its first layer: 500 bytes of header, rows, columns."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(508)
    if len(start) < 508:
        raise InputError(
            path, f"{size} bytes are less than a .plu header: the file is truncated", _MEASURE_AGAIN
        )
    rows, columns = struct.unpack_from("<II", start, 500)
    if not (0 < rows < _LARGEST_PLU_SIDE and 0 < columns < _LARGEST_PLU_SIDE):
        raise InputError(
            path,
            f"its first layer announces {rows} × {columns} points: not a .plu topography",
            "Export the scan again, or correct the file's ending.",
        )
    needed = 508 + 4 * rows * columns
    if size < needed:
        raise InputError(
            path,
            f"{rows} × {columns} points take {needed} bytes, but the file has {size}: it is "
            "truncated",
            _MEASURE_AGAIN,
        )


def _read_points(
    path: Path,
    factor: float,
    scatter_spacing: float | None,
    scatter_extent: Sequence[float] | None,
) -> tuple[np.ndarray, tuple, dict]:
    """Heights (ny, nx) mm and spacing (dy, dx) mm from a text file of points."""
    x, y, z = _load_columns(path).T * factor
    grid = _as_grid(x, y)
    if grid is not None:
        (columns, dx), (rows, dy) = grid
        heights = np.full((rows.max() + 1, columns.max() + 1), np.nan)
        heights[rows, columns] = z
        return heights, (dy, dx), {}
    if scatter_spacing is None:
        raise InputError(
            path,
            f"its {len(x)} points are scattered, not on a grid",
            "Set scans.scatter_spacing_um in the config to the spacing to grid them with.",
        )
    x0, x1, y0, y1 = scatter_extent or (x.min(), x.max(), y.min(), y.max())
    nx, ny = (round((end - start) / scatter_spacing) for start, end in ((x0, x1), (y0, y1)))
    if min(nx, ny) < 2 or nx * ny > 1 << 26:
        raise InputError(
            path,
            f"gridding {x1 - x0:.4g} × {y1 - y0:.4g} mm every {scatter_spacing:g} mm "
            f"makes {nx} × {ny} elements",
            "Check scans.unit, scatter_spacing_um and scatter_extent_mm in the config.",
        )
    from scipy.interpolate import griddata

    centres = np.meshgrid(
        axis_coordinates(nx, scatter_spacing, x0), axis_coordinates(ny, scatter_spacing, y0)
    )
    heights = griddata((x, y), z, tuple(centres), method="linear")
    return heights, (scatter_spacing, scatter_spacing), {"gridded": "linearly, from points"}


def _load_columns(path: Path) -> np.ndarray:
    """The first three columns of a text file, (points, 3)."""
    failure: Exception | None = None
    for delimiter in (None, ",", ";"):
        try:
            points = np.loadtxt(
                path, usecols=(0, 1, 2), delimiter=delimiter, ndmin=2, encoding="utf-8-sig"
            )
        except (ValueError, IndexError) as error:
            failure = failure or error
            continue
        if len(points) >= 4:
            # A point without x or y is nowhere; one without z is unmeasured.
            return points[np.isfinite(points[:, :2]).all(axis=1)]
        failure = ValueError(f"only {len(points)} points")
    raise InputError(
        path,
        f"cannot be read as columns x, y, z of numbers ({failure})",
        "Export the points as text, one 'x y z' a line; comments begin with '#'.",
    )


def _as_grid(x: np.ndarray, y: np.ndarray):
    """((column of each point, dx), (row of each point, dy)), or None if they are scattered."""
    axes = []
    for values in (x, y):
        levels = np.unique(values)
        gaps = np.diff(levels)
        if not len(gaps):
            return None
        # Rounded text repeats a coordinate with small differences; real steps are larger.
        step = float(np.median(gaps[gaps > _GRID_TOLERANCE * gaps.max()]))
        index = np.round((values - levels[0]) / step)
        span = index.max()
        if span < 1 or span > 1 << 16:
            return None
        step = float(levels[-1] - levels[0]) / span
        index = np.round((values - levels[0]) / step).astype(int)
        if np.abs(values - levels[0] - index * step).max() > _GRID_TOLERANCE * step:
            return None
        axes.append((index, step))
    (columns, _), (rows, _) = axes
    places = rows.astype(np.int64) * (columns.max() + 1) + columns
    if len(np.unique(places)) < len(places):
        return None
    return axes
