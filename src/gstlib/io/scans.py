"""Height maps as the instrument wrote them, as surfaces in mm.

Which formats, through which reader, and what has been checked of each is in docs/formats.md. Files
are not trusted: whatever their bytes, `read_scan` returns a plausible surface or says why not.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.bounds import LARGEST_FILE
from gstlib.io.gsf import read_gsf
from gstlib.io.height_map import SCAN_UNITS, HeightMap, Unsaid
from gstlib.io.matrices import read_matrix
from gstlib.io.points import read_points
from gstlib.surface import make_surface, spacing_of

__all__ = ["SCAN_UNITS", "check_size", "cut_scan", "read_scan", "read_settings"]

# What a profilometer of any kind can have measured (mm); outside it the unit is wrong.
_LARGEST_FIELD, _LARGEST_RANGE = 50.0, 10.0
_SMALLEST_SPACING, _LARGEST_SPACING = 1e-6, 0.5
# 8192 × 8192; contact of more points than that is not solved here.
_MOST_POINTS = 1 << 26
# A scan may differ from the study's size by this share: pixel sizes are rounded (512 × 1.66 µm is
# 849.92 µm), and a row more or less does no harm.
_SIZE_TOLERANCE = 0.01
# Spacings come from float32 numbers or text; digits beyond these are noise.
_SPACING_DIGITS = 7

_MEASURE_AGAIN = "Export or copy the scan again."


def read_scan(
    path: str | Path,
    *,
    unit: str | None = None,
    spacing_mm: float | None = None,
    scatter_spacing_mm: float | None = None,
    scatter_extent_mm: Sequence[float] | None = None,
) -> xr.DataArray:
    """Read a height map from an instrument's file.

    Parameters
    ----------
    path : str or Path
        An instrument's file (.plu, .plux, .sur, .x3p, .al3d, .vk4, .gwy, .gsf, .sdf, or another
        that SurfaceTopography reads); a matrix of heights in text, a row of the map a line (.csv,
        .txt, .asc); or points in text (.xyz: columns x, y, z), on a grid or scattered.
    unit : {"m", "mm", "um", "nm"}, optional
        Unit of files that do not name theirs; of no effect on the others.
    spacing_mm : float, optional
        Distance of the points in files that do not tell theirs; of no effect on the others.
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
        spacing to grid it with is not known; its size is absurd; nothing in it is measured; or it
        takes more memory or time to read than its size warrants (see `gstlib.io.bounds`).

    Notes
    -----
    Of a file with several height maps the first is read, and a warning logged.
    """
    path = Path(path)
    if unit is not None and unit not in SCAN_UNITS:
        raise InputError(path, f"unknown scan unit {unit!r}", f"Use one of {list(SCAN_UNITS)}.")
    if not path.is_file():
        raise InputError(
            path, "no such file", "Correct the name in the patch table, or the folder."
        )
    size = path.stat().st_size
    if size == 0:
        raise InputError(path, "the file is empty", _MEASURE_AGAIN)
    if size > LARGEST_FILE:
        raise InputError(
            path, f"{size} bytes are too many for a scan", "Cut it in the instrument's software."
        )
    unsaid = Unsaid(unit, spacing_mm)
    try:
        with np.errstate(all="ignore"):  # what overflows is refused below
            raw = _read(path, unsaid, scatter_spacing_mm, scatter_extent_mm)
    except OSError as error:
        raise InputError(
            path, f"cannot be opened ({error.strerror})", "Check the rights to read it."
        ) from error
    # No instrument measures an infinite height; some exports mark unmeasured points with it.
    heights = np.where(np.isfinite(raw.heights), raw.heights, np.nan)
    spacing = tuple(float(f"{step:.{_SPACING_DIGITS}g}") for step in raw.spacing)
    _check_plausible(path, heights, spacing)
    return make_surface(
        heights, spacing, long_name="height as measured", file=path.name, **raw.attrs
    )


def read_settings(scans: Mapping) -> dict:
    """Keyword arguments of `read_scan` from the section ``scans`` of a config."""

    def in_mm(length_um: float | None) -> float | None:
        return None if length_um is None else length_um * 1e-3

    extent = scans["scatter_extent_mm"]
    return {
        "unit": scans["unit"],
        "spacing_mm": in_mm(scans["spacing_um"]),
        "scatter_spacing_mm": in_mm(scans["scatter_spacing_um"]),
        "scatter_extent_mm": None if extent is None else tuple(extent),
    }


def _read(
    path: Path,
    unsaid: Unsaid,
    scatter_spacing_mm: float | None,
    scatter_extent_mm: Sequence[float] | None,
) -> HeightMap:
    match path.suffix.lower():
        case ".xyz":
            return read_points(path, unsaid, scatter_spacing_mm, scatter_extent_mm)
        case ".csv" | ".txt" | ".asc":
            return read_matrix(path, unsaid)
        case ".gsf":
            return read_gsf(path, unsaid)
        case _:
            # takes a second or two
            from gstlib.io.instruments import read_instrument_file

            return read_instrument_file(path, unsaid)


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


def _check_plausible(path: Path, heights: np.ndarray, spacing: Sequence[float]) -> None:
    ny, nx = heights.shape
    if min(ny, nx) < 2:
        raise InputError(path, f"holds {ny} × {nx} points, not a map", "Export the whole map.")
    if ny * nx > _MOST_POINTS:
        raise InputError(
            path, f"holds {ny} × {nx} points, too many", "Cut it in the instrument's software."
        )
    if not np.isfinite(heights).any():
        raise InputError(path, "not one point is measured", "Measure the patch again.")
    remedy = "Check scans.unit in the config, and the instrument's export."
    if not (np.isfinite(spacing).all() and min(spacing) > 0):
        raise InputError(
            path, f"points every {spacing[1]:g} × {spacing[0]:g} mm make no map", remedy
        )
    field = max(ny * spacing[0], nx * spacing[1])
    with np.errstate(over="ignore"):
        extent = float(np.nanmax(heights) - np.nanmin(heights))
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
