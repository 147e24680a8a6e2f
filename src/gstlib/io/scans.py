"""Height maps as the instrument wrote them, as surfaces in mm.

docs/reference/formats.md lists the formats and how each was checked. `read_scan` returns a
plausible surface, or explains why it cannot. Each format has a reader. It returns the heights (ny,
nx) in the file's unit, NaN where unmeasured, and the spacing (dy, dx) in this unit. It also returns
the length of the unit in mm, and the description of the instrument. Spacing and unit are None if
the file does not contain them.
"""

import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import NOTE, FaultError, InputError, refuse
from gstlib.io.files import UnreadableError, check_input, naming
from gstlib.io.instruments import instrument_endings, plain_text, read_instrument_file
from gstlib.io.plu import read_plu
from gstlib.io.points import read_points
from gstlib.io.stage import RawMap
from gstlib.io.text import SCAN_UNITS, read_matrix
from gstlib.surfaces.grid import make_surface, spacing_of

__all__ = ["cut_scan", "is_scan", "read_scan", "unit_remedy", "whole_scan"]

_log = logging.getLogger(__name__)

_READERS: dict[str, Callable[[Path], RawMap]] = {
    ".plu": read_plu,
    ".apx": read_plu,
    ".x3p": read_instrument_file,
}
# These are given unit and spacing of the config, too, with which they may disagree.
_TEXT_READERS: dict[str, Callable[[Path, str | None, float | None], RawMap]] = {
    ".csv": read_matrix,
    ".txt": read_matrix,
    ".asc": read_matrix,
    ".xyz": read_points,
}
# Range of any profilometer (mm). Outside this range the unit is wrong.
_LARGEST_FIELD, _LARGEST_RANGE = 50.0, 10.0
_SMALLEST_SPACING, _LARGEST_SPACING = 1e-6, 0.5
# Heights (mm) beyond this are the largest numbers of a format, in whatever unit.
_LARGEST_NUMBER = 1e20
# ASSUME: Placeholder heights. A height that ten points or more share marks unmeasured points if it
# is far from the others. Its distance from the median of the distinct heights is then at least five
# interquartile ranges. Reason: Measured heights are not repeated so far from the others.
_FEWEST_HELD, _FAR = 10, 5
# A less distant height may be one too, if more than this share of the points has it, and ten times
# as many as any other. Heights measured in few steps are about equally frequent.
_HELD_FRACTION, _HELD_TIMES = 1e-3, 10
# A scan may differ from the study's size by this share. Pixel sizes are rounded (512 × 1.66 µm is
# 849.92 µm), and one row more or less does not matter.
_SIZE_TOLERANCE = 0.01
# Spacings come from float32 numbers or text. Digits beyond these are noise.
_SPACING_DIGITS = 7


def read_scan(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> xr.DataArray:
    """Read a height map from an instrument's file.

    Parameters
    ----------
    path : str or Path
        Either an instrument's file (.plu, .plux, .sur, .x3p, .al3d, .vk4, .gwy, .sdf, or another
        that SurfaceTopography reads), a matrix of heights in text with one row of the map in each
        line (.csv, .txt, .asc), or points on a grid in text (.xyz: columns x, y, z).
    unit : {"m", "mm", "um", "nm"}, optional
        Unit of files that do not contain it. It has no effect on others. A line in a text with a
        unit that is not understood is refused.
    spacing_um : float, optional
        Distance (µm) of the points in files that do not contain it. It has no effect on others.
        Coordinates beside a matrix, and numbers instead of the x and y of points, must agree.

    Returns
    -------
    (ny, nx) xarray.DataArray
        Surface in mm with rows and columns as in the file, NaN where unmeasured, beginning at (0,
        0). Its attributes (text) are ``file``, ``unit_stated`` (yes or no, by the file) and the
        file's description of the instrument.

    Raises
    ------
    InputError
        The file is missing, truncated, unreadable or not a map. Its unit or spacing is unknown. Its
        size is absurd. No point is measured.

    Notes
    -----
    If a file has several height maps, the first is read, with a note. There is a warning if many
    points share a height. If this height is far from all others, its points count as unmeasured.

    Examples
    --------
    >>> import gstlib, pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name) / "scan.csv"
    >>> size = path.write_text("1.0,2.5,3.0\\n4.0,,6.0\\n")
    >>> scan = gstlib.read_scan(path, unit="um", spacing_um=1.66)
    >>> scan.values.tolist()
    [[0.001, 0.0025, 0.003], [0.004, nan, 0.006]]
    >>> gstlib.spacing_of(scan)
    (0.00166, 0.00166)
    """
    path = Path(path)
    with naming(path):
        if unit not in (None, *SCAN_UNITS):
            raise UnreadableError(
                f"unknown scan unit {unit!r}", f"Use one of {list(SCAN_UNITS)}."
            )
        check_input(path, "Correct the name in the patch table, or the folder.")
        unit_mm = SCAN_UNITS.get(unit or "")
        step_mm = None if spacing_um is None else spacing_um * 1e-3
        ending = path.suffix.lower()
        if read_text := _TEXT_READERS.get(ending):
            config_step = step_mm / unit_mm if step_mm and unit_mm else None
            raw, steps, length, attrs = read_text(path, unit, config_step)
        else:
            raw, steps, length, attrs = _READERS.get(ending, read_instrument_file)(path)
        is_stated = length is not None
        attrs["unit_stated"] = "yes" if is_stated else "no"
        length = length if is_stated else unit_mm
        steps_mm = step_mm and (step_mm, step_mm)
        if steps is not None and length is not None:
            steps_mm = steps[0] * length, steps[1] * length
        if length is None or not steps_mm:
            raise _not_stated(unit=length is None, spacing=not (steps or spacing_um))
        spacing = tuple(float(f"{step:.{_SPACING_DIGITS}g}") for step in steps_mm)
        with np.errstate(all="ignore"):  # overflows are refused below
            heights = raw * length
        # Some exports mark unmeasured points with infinity, or the largest number there is.
        heights[np.abs(heights) > _LARGEST_NUMBER] = np.nan
        _mind_held(path, heights)
        _check_plausible(path, heights, spacing, states_unit=is_stated)
        _refuse_lost_block(path, heights)
        attrs = {name: plain_text(value) for name, value in attrs.items()}
        if "layer" in attrs:
            _log.log(NOTE, "%s: only %s, is read", path, attrs["layer"])
        return make_surface(
            heights, spacing, long_name="height as measured"
        ).assign_attrs(file=path.name, **attrs)


def is_scan(path: str | Path) -> bool:
    """Whether a file has the ending of a height map that `read_scan` reads."""
    return Path(path).suffix.lower() in (
        *_READERS,
        *_TEXT_READERS,
        *instrument_endings(),
    )


def _not_stated(*, unit: bool, spacing: bool) -> UnreadableError:
    """The file does not contain its unit nor, perhaps, the spacing of its points."""
    keys = {}
    if unit:
        keys["its unit of length"] = (
            f"scans.unit in the config to one of {list(SCAN_UNITS)}"
        )
    if spacing:
        keys["the spacing of its points"] = (
            "scans.spacing_um in the config to its value in µm"
        )
    return UnreadableError(
        f"the file does not state {' or '.join(keys)}",
        f"Set {', and '.join(keys.values())}, or export the scan in a format that states them "
        "(.plu, .plux, .sur, .x3p, .al3d, ...).",
    )


def cut_scan(
    scan: xr.DataArray, centre: Sequence[float] | None, size_mm: float
) -> xr.DataArray:
    """The patch of a scan: a square piece, or all of it.

    Parameters
    ----------
    scan : (ny, nx) xarray.DataArray
        The whole scan, mm.
    centre : (y, x) or None
        Centre of the piece in mm, from the scan's centre along its rows and columns. None stands
        for the whole scan, which must be a square of this size within one per cent.
    size_mm : float
        Side of the piece, which is cut at whole elements.

    Returns
    -------
    (n, m) xarray.DataArray
        The piece, beginning at (0, 0).

    Raises
    ------
    InputError
        The piece sticks out of the scan, or the whole scan has another size.
    """
    height, width = _sides_of(scan)
    source = scan.attrs.get("file", "scan")
    if centre is None:
        if max(abs(height - size_mm), abs(width - size_mm)) > _SIZE_TOLERANCE * size_mm:
            raise InputError(
                source,
                f"the scan is {width:.4g} × {height:.4g} mm ({scan.shape[1]} × {scan.shape[0]} "
                f"points), but the study's patches are {size_mm:g} × {size_mm:g} mm",
                "Correct scans.size_mm in the config, or have a piece of the scan cut: give "
                "crop_x_mm and crop_y_mm in the patch table.",
            )
        return scan
    slices = []
    beyond = 0.0
    for length, step, middle in zip(scan.shape, spacing_of(scan), centre, strict=True):
        count = round(size_mm / step)
        # Half an element is always rounded up, so adjacent pieces stay adjacent.
        first = math.floor(length / 2 + middle / step - count / 2 + 0.5 + 1e-9)
        beyond = max(beyond, -first * step, (first + count - length) * step)
        slices.append(slice(first, first + count))
    if beyond > 0:
        raise InputError(
            source,
            f"a piece of {size_mm:g} mm around x = {centre[1]:g}, y = {centre[0]:g} mm sticks out "
            f"by {beyond:.4g} mm of the scan of {width:.4g} × {height:.4g} mm",
            "Correct crop_x_mm and crop_y_mm in the patch table: they are relative to its centre.",
        )
    piece = make_surface(scan.values[tuple(slices)], spacing_of(scan))
    return piece.assign_attrs(scan.attrs)


def _sides_of(scan: xr.DataArray) -> tuple[float, float]:
    """Height and width of a scan, mm."""
    (ny, nx), (dy, dx) = scan.shape, spacing_of(scan)
    return ny * dy, nx * dx


def whole_scan(scan: xr.DataArray, size_mm: float) -> xr.DataArray:
    """A later scan of a patch, uncut: only registration locates the patch in it.

    Raises
    ------
    InputError
        It is smaller than a patch of this side.
    """
    height, width = _sides_of(scan)
    if min(height, width) < (1 - _SIZE_TOLERANCE) * size_mm:
        raise InputError(
            scan.attrs.get("file", "scan"),
            f"the scan is {width:.4g} × {height:.4g} mm, smaller than the study's patches of "
            f"{size_mm:g} × {size_mm:g} mm",
            "Scan all of the patch again, or correct scans.size_mm in the config.",
        )
    return scan


def _mind_held(path: Path, heights: np.ndarray) -> None:
    """Warn of a height that marks unmeasured points: 0, or another number.

    If it is far from all others, this is certain, and it becomes NaN. Pits and spikes are as far
    away, but seldom equally high.
    """
    distinct, counts = np.unique(heights[np.isfinite(heights)], return_counts=True)
    if counts.max(initial=0) < _FEWEST_HELD:
        return
    low, middle, high = np.quantile(distinct, (0.25, 0.5, 0.75))
    is_far = np.abs(distinct - middle) > _FAR * (high - low)
    far = np.where(is_far, counts, 0)
    held, count = distinct[np.argmax(far)], far.max()
    if _FEWEST_HELD <= count < heights.size / 2 and 2 * count > far.sum():
        heights[heights == held] = np.nan
        message = (
            "%s: %d points share the height %g µm, far from all others. They count as "
            "unmeasured"
        )
        _log.warning(message, path, count, held * 1e3)
        return
    second, most = np.sort([0, *counts])[-2:]
    if most > max(_HELD_FRACTION * heights.size, _HELD_TIMES * second):
        _log.warning(
            "%s: %.3g %% of the points have one height, %g µm. If it marks unmeasured "
            "points, export them as empty cells or NaN",
            path,
            100 * most / heights.size,
            distinct[np.argmax(counts)] * 1e3,
        )


def _refuse_lost_block(path: Path, heights: np.ndarray) -> None:
    """Refuse consecutive zeros, as after the loss of a block of the file.

    If they mark unmeasured points, they begin and end with a line of the map, or each of several
    lines contains about as many. In a smooth map, other heights are repeated, too.
    """
    flat, width = heights.ravel(), heights.shape[1]
    starts = np.flatnonzero(np.diff(flat, prepend=np.nan) != 0)
    lengths = np.diff(starts, append=flat.size)
    longest = int(np.argmax(lengths))
    start, count = int(starts[longest]), int(lengths[longest])
    repeated = int(np.delete(lengths, longest).max(initial=1))
    whole_lines = start % width == count % width == 0
    most_elsewhere = min(count // _HELD_TIMES, _FEWEST_HELD - 1)
    if flat[start] == 0 and not whole_lines and repeated <= most_elsewhere:
        problem = (
            f"{count} consecutive heights, from number {start + 1} on, are 0, but elsewhere "
            f"at most {repeated} are equal: a block of the file is lost"
        )
        refuse(
            FaultError(
                "odd_scan", path, problem, "Copy the file, or export the scan, again."
            )
        )


def unit_remedy(states_unit: bool) -> str:
    """The remedy for heights in a wrong unit. The config does not affect files with a unit."""
    if states_unit:
        return "The unit is in the file, not in scans.unit. Correct the instrument's export."
    return "Check scans.unit in the config, and the instrument's export."


def _check_plausible(
    path: Path, heights: np.ndarray, spacing: Sequence[float], *, states_unit: bool
) -> None:
    """Refuse a map that no profilometer can have measured."""
    (ny, nx), (dy, dx) = heights.shape, spacing
    if min(ny, nx) < 2:
        raise UnreadableError(
            f"contains {ny} × {nx} points, not a map", "Export the whole map."
        )
    if not np.isfinite(heights).any():
        raise UnreadableError("no point is measured", "Measure the patch again.")
    extent = float(np.nanmax(heights) - np.nanmin(heights))
    if (
        not all(_SMALLEST_SPACING <= step <= _LARGEST_SPACING for step in spacing)
        or max(ny * dy, nx * dx) > _LARGEST_FIELD
        or extent > _LARGEST_RANGE
    ):
        problem = (
            f"{nx} × {ny} points every {dx:.4g} × {dy:.4g} mm, whose heights range over "
            f"{extent:.4g} mm, are not a surface scan: its unit is wrong, or unmeasured points are "
            "stored as a number"
        )
        refuse(FaultError("odd_scan", path, problem, unit_remedy(states_unit)))
