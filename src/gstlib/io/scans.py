"""Height maps as the instrument wrote them, as surfaces in mm.

docs/reference/formats.md lists the formats and how each was checked. `read_scan` returns a
plausible surface, or says why it cannot. Each format has a reader that returns the heights (ny, nx)
in the file's unit, NaN where unmeasured; the spacing (dy, dx) in that unit, None if the file does
not state it; the length of the unit in mm, None likewise; and what the file says about the
instrument.
"""

import io
import logging
import math
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.files import check_size, check_unpacked, check_unpacked_size
from gstlib.io.plu import read_plu
from gstlib.io.text import SCAN_UNITS, read_matrix, read_points
from gstlib.surfaces.grid import make_surface, spacing_of

__all__ = ["cut_scan", "read_scan", "whole_scan"]

_log = logging.getLogger(__name__)

# Formats that SurfaceTopography does not read for us: we read text more strictly; its `hgt` reader
# checks no signature and takes any bytes for heights; its `nms` reader takes the field to be a
# million times as large.
_NOT_LEFT = {"asc", "hgt", "nms", "plu", "xyz"}
# Objects in Digital Surf files without heights: binary, intensity and colour images, spectra.
_SUR_NO_HEIGHTS = {3, 10, 12, 20, 21}
# What any profilometer can have measured (mm); outside this range the unit is wrong.
_LARGEST_FIELD, _LARGEST_RANGE = 50.0, 10.0
_MOST_POINTS = 1 << 26
# Measured heights take at least half a byte each, however packed; a small map may hold nothing.
_POINTS_PER_BYTE, _FEW_POINTS = 2, 1 << 22
_SMALLEST_SPACING, _LARGEST_SPACING = 1e-6, 0.5
# Heights (mm) beyond this are the largest numbers of a format, in whatever unit.
_LARGEST_NUMBER = 1e20
# ASSUME: a height that ten points or more share, five interquartile ranges of the distinct heights
# from their median, was written where nothing was measured.
_FEWEST_HELD, _FAR = 10, 5
# A less distant height may be one too, if more than this share of the points has it, and ten times
# as many as any other: heights measured in few steps are about equally frequent.
_HELD_FRACTION, _HELD_TIMES = 1e-3, 10
# A scan may differ from the study's size by this share: pixel sizes are rounded (512 × 1.66 µm is
# 849.92 µm), and one row more or less does not matter.
_SIZE_TOLERANCE = 0.01
# Spacings come from float32 numbers or text; digits beyond these are noise.
_SPACING_DIGITS = 7
_LONGEST_TEXT = 200
_AS_MEASURED = (
    "%s: an .mnt holds the map as it was measured; what was levelled, shifted or extracted from it "
    "in Mountains is not applied. Save that map as .sur"
)
# In a Digital Surf header six units begin at byte 180, 16 bytes each, in Latin-1. Some programs
# write µ, or the Greek letter, in UTF-8.
_SUR_MARKS = b"DIGITAL SURF", b"DSCOMPRESSED"
_SUR_UNITS, _SUR_UNIT = range(180, 276, 16), 16
# Length of the header; where it states those of comment and private zone, which follow it.
_SUR_HEADER, _SUR_ZONES = 512, 334
_MICRO, _OTHER_MICRO = b"\xb5", ("µ".encode(), "μ".encode())

_Raw = tuple[np.ndarray, tuple[float, float] | None, float | None, dict[str, str]]


def read_scan(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> xr.DataArray:
    """Read a height map from an instrument's file.

    Parameters
    ----------
    path : str or Path
        An instrument's file (.plu, .plux, .sur, .x3p, .al3d, .vk4, .gwy, .sdf, or another that
        SurfaceTopography reads); a matrix of heights in text, a row of the map a line (.csv, .txt,
        .asc); or points on a grid in text (.xyz: columns x, y, z).
    unit : {"m", "mm", "um", "nm"}, optional
        Unit of files that do not state theirs; no effect on others.
    spacing_um : float, optional
        Distance (µm) of the points in files that do not state it; no effect on others.

    Returns
    -------
    (ny, nx) xarray.DataArray
        Surface in mm with rows and columns as in the file, NaN where unmeasured, beginning at
        (0, 0); attributes (text): ``file`` and what the file says about the instrument.

    Raises
    ------
    InputError
        The file is missing, truncated, unreadable or not a map; its unit or spacing is
        unknown; its size is absurd; or no point is measured.

    Notes
    -----
    If a file has several height maps, the first is read, with a warning. There is also a warning if
    many points share a height (if that is far from all others, they count as unmeasured), and if
    the spacing seems to be computed with one point too few.
    """
    path = Path(path)
    if unit is not None and unit not in SCAN_UNITS:
        raise InputError(path, f"unknown scan unit {unit!r}", f"Use one of {list(SCAN_UNITS)}.")
    if not path.is_file():
        raise InputError(
            path, "no such file", "Correct the name in the patch table, or the folder."
        )
    if path.stat().st_size == 0:
        raise InputError(path, "the file is empty", "Copy it, or export it, again.")
    check_size(path)
    readers: dict[str, Callable[[Path], _Raw]] = {
        **dict.fromkeys((".plu", ".apx"), read_plu),
        **dict.fromkeys((".csv", ".txt", ".asc"), read_matrix),
        ".xyz": read_points,
    }
    read = readers.get(path.suffix.lower(), _read_instrument_file)
    raw, steps, length, attrs = read(path)
    if length is None and unit is not None:
        length = SCAN_UNITS[unit]
    steps_mm = None if spacing_um is None else (spacing_um * 1e-3, spacing_um * 1e-3)
    if steps is not None and length is not None:
        steps_mm = steps[0] * length, steps[1] * length
    if length is None or steps_mm is None:
        raise _not_stated(
            path, unit=length is None, spacing=steps is None and spacing_um is None
        )
    spacing = tuple(float(f"{step:.{_SPACING_DIGITS}g}") for step in steps_mm)
    with np.errstate(all="ignore"):  # overflows are refused below
        heights = raw * length
    # Some exports mark unmeasured points with infinity, or the largest number there is.
    heights[np.abs(heights) > _LARGEST_NUMBER] = np.nan
    _mind_held(path, heights)
    _check_plausible(path, heights, spacing)
    _mind_step_too_few(path, heights.shape, spacing)
    attrs = {name: _plain_text(value) for name, value in attrs.items()}
    if "layer" in attrs:
        _log.warning("%s: only %s, is read", path, attrs["layer"])
    return make_surface(heights, spacing, long_name="height as measured").assign_attrs(
        file=path.name, **attrs
    )


def _not_stated(path: Path, *, unit: bool, spacing: bool) -> InputError:
    """The file states neither its unit nor, perhaps, the spacing of its points."""
    lacks, keys = [], []
    if unit:
        lacks.append("its unit of length")
        keys.append(f"scans.unit in the config to one of {list(SCAN_UNITS)}")
    if spacing:
        lacks.append("the spacing of its points")
        keys.append("scans.spacing_um in the config to their distance in µm")
    return InputError(
        path,
        f"the file does not state {' or '.join(lacks)}",
        f"Set {', and '.join(keys)}; or export the scan in a format that states them (.plu, .plux, "
        ".sur, .x3p, .al3d, ...).",
    )


def _mind_step_too_few(path: Path, shape: tuple[int, ...], spacing: tuple[float, ...]) -> None:
    """Warn if the points would be square with the length divided by n points, not n - 1."""
    (dy, dx), (ny, nx) = spacing, shape
    if min(shape) > 1:
        true_y, true_x = dy * (ny - 1) / ny, dx * (nx - 1) / nx
        if abs(dx / dy - 1) > 1e-5 and abs(true_x / true_y - 1) < 0.1 * abs(dx / dy - 1):
            _log.warning(
                "%s: its points are %.5g × %.5g µm apart, as if a length of n points had been "
                "divided by n - 1; then they are %.5g µm apart. Export the scan in another format "
                "and compare",
                path,
                1e3 * dx,
                1e3 * dy,
                1e3 * true_x,
            )


def _read_instrument_file(path: Path) -> _Raw:
    """Read the first height map of a file through SurfaceTopography.

    It returns heights as [ix, iy], in a unit that differs between files (Röttger et al. 2022, Surf.
    Topogr.: Metrol. Prop. 10:035032).
    """
    try:  # here, for its import takes a second or two
        from SurfaceTopography.IO import open_topography, readers
        from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor
    except ImportError as error:
        problem = "cannot be read: SurfaceTopography, which reads its format, is not installed"
        raise InputError(path, problem, "Install it: pip install 'gstlib[formats]'") from error

    formats = {
        f".{ending}": reader.format()
        for reader in readers
        for ending in reader.file_extensions()
        if reader.format() not in _NOT_LEFT
    }
    own_format = (
        "Export the scan in the instrument's own format (.plu, .plux, .al3d, .sur, ...)."
    )
    if path.suffix.lower() not in formats:
        problem = f"cannot be read as a height map: the ending '{path.suffix}' is unknown"
        raise InputError(path, problem, own_format)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # about odd dates and numbers; what matters is checked
            reader = open_topography(_unwrapped(path), format=formats[path.suffix.lower()])
            maps = [c for c in reader.channels if c.dim == 2 and c.is_height_channel]
            kind = reader.metadata["header"]["type"] if reader.format() == "sur" else None
            if not maps or kind in _SUR_NO_HEIGHTS:
                raise ValueError("it holds no map of heights")
            channel = maps[0]
            most = max(_FEW_POINTS, _POINTS_PER_BYTE * path.stat().st_size)
            if math.prod(channel.nb_grid_pts) > min(_MOST_POINTS, most):
                nx, ny = channel.nb_grid_pts
                raise ValueError(f"it announces {nx} × {ny} points, more than it can hold")
            stated = channel.physical_sizes is not None
            topography = channel.topography(**{} if stated else {"physical_sizes": (1.0, 1.0)})
            masked: np.ma.MaskedArray = np.ma.asarray(topography.heights(), dtype=float)
            heights: np.ndarray = masked.filled(np.nan).T
            if heights.shape != tuple(channel.nb_grid_pts)[::-1]:
                raise ValueError(f"{heights.shape} points for {channel.nb_grid_pts} announced")
            unit, (size_x, size_y) = topography.unit, topography.physical_sizes
            length = None if unit is None else get_unit_conversion_factor(unit, "mm")
            ny, nx = heights.shape
            spacing = (float(size_y) / ny, float(size_x) / nx) if stated else None
            if reader.format() == "mnt":
                _log.warning(_AS_MEASURED, path)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # the readers raise whatever their parsers raise
        reason = _plain_text(f"{type(error).__name__}: {error} {error.__cause__ or ''}")
        problem = (
            f"cannot be read as a height map ({reason}): it is damaged or in another format"
        )
        raise InputError(path, problem, own_format) from error
    instrument = topography.info.get("instrument") or {}
    known = {
        "instrument": instrument.get("name"),
        "vendor": instrument.get("vendor"),
        "acquired": topography.info.get("acquisition_time"),
        "layer": f"{channel.name}, the first of {len(maps)} height maps" if maps[1:] else None,
    }
    attrs = {name: str(value) for name, value in known.items() if value is not None}
    return heights, spacing, length, attrs


def _unwrapped(path: Path) -> str | io.BytesIO:
    """A file in the form that SurfaceTopography reads: `.sur` and `.x3p` by their standards.

    Some programs zip the folder around the `.x3p`'s members, or write its revision with another
    dash; the later revision has the same members.
    """
    content = io.BytesIO()
    with path.open("rb") as file:
        mark = file.read(12)
        if path.suffix.lower() == ".x3p":
            with zipfile.ZipFile(file) as given, zipfile.ZipFile(content, "w") as plain:
                names = [name for name in given.namelist() if f"/{name}".endswith("/main.xml")]
                main = min(names, key=len, default="")
                check_unpacked(path, given, [main])
                record = given.read(main)
                folder = main.removesuffix("main.xml")
                # no other member is needed, whatever it holds
                named = [
                    name
                    for name in given.namelist()
                    if name.startswith(folder) and name.removeprefix(folder).encode() in record
                ]
                check_unpacked(path, given, named)
                revision = rb"\g<1>ISO5436 - 2000"
                plain.writestr("main.xml", re.sub(rb"(<Revision>)[^<]*", revision, record))
                for name in named:
                    plain.writestr(name.removeprefix(folder), given.read(name))
        elif mark in _SUR_MARKS:
            content.write(_plain_sur(path, mark + file.read()))
        else:
            if zipfile.is_zipfile(path):
                with zipfile.ZipFile(path) as given:
                    check_unpacked(path, given)
            return str(path)
    content.seek(0)
    return content


def _plain_sur(path: Path, content: bytes) -> bytes:
    """A `.sur` without compression, with the micro signs of its units in Latin-1."""
    plain = bytearray(content)
    if content.startswith(b"DSCOMPRESSED"):
        start = _SUR_HEADER + sum(struct.unpack_from("<HH", content, _SUR_ZONES))
        (streams,) = struct.unpack_from("<I", content, start)
        sizes = np.frombuffer(content, "<u4", 2 * streams, start + 4).reshape(-1, 2).tolist()
        check_unpacked_size(path, sum(size for size, _ in sizes))
        plain = bytearray(b"DIGITAL SURF" + content[12:start])
        at = start + 4 + 8 * streams
        for size, packed in sizes:
            # no more than is stated, whatever the stream holds
            plain += zlib.decompressobj().decompress(content[at : at + packed], size)
            at += packed
    for start in _SUR_UNITS:
        unit = bytes(plain[start : start + _SUR_UNIT]).strip(b" \0")
        for other in _OTHER_MICRO:
            unit = unit.replace(other, _MICRO)
        plain[start : start + _SUR_UNIT] = unit.ljust(_SUR_UNIT, b"\0")
    return bytes(plain)


def _plain_text(value: str) -> str:
    """One short line of printable text: HDF5 attributes hold no NUL and no lone surrogate."""
    text = value.encode("utf-8", "replace").decode("utf-8")
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[
        :_LONGEST_TEXT
    ]


def cut_scan(
    scan: xr.DataArray, centre: Sequence[float] | None, size_mm: float
) -> xr.DataArray:
    """The patch of a scan: a square piece, or all of it.

    Parameters
    ----------
    scan : (ny, nx) xarray.DataArray
        The whole scan, mm.
    centre : (y, x) or None
        Centre of the piece in mm, from the scan's centre along its rows and columns; None for the
        whole scan, which must be a square of that size within one per cent.
    size_mm : float
        Side of the piece; it is cut at whole elements.

    Returns
    -------
    (n, m) xarray.DataArray
        The piece, beginning at (0, 0).

    Raises
    ------
    InputError
        The piece sticks out of the scan, or the whole scan has another size.
    """
    height, width = (n * step for n, step in zip(scan.shape, spacing_of(scan), strict=True))
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
    slices, beyond = [], 0.0
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
    return make_surface(scan.values[tuple(slices)], spacing_of(scan)).assign_attrs(scan.attrs)


def whole_scan(scan: xr.DataArray, size_mm: float) -> xr.DataArray:
    """A later scan of a patch, uncut: only registration tells which piece of it the patch is.

    Raises
    ------
    InputError
        It is smaller than a patch of this side.
    """
    height, width = (n * step for n, step in zip(scan.shape, spacing_of(scan), strict=True))
    if min(height, width) < (1 - _SIZE_TOLERANCE) * size_mm:
        raise InputError(
            scan.attrs.get("file", "scan"),
            f"the scan is {width:.4g} × {height:.4g} mm, smaller than the study's patches of "
            f"{size_mm:g} × {size_mm:g} mm",
            "Scan all of the patch again, or correct scans.size_mm in the config.",
        )
    return scan


def _mind_held(path: Path, heights: np.ndarray) -> None:
    """Warn of a height that stands for unmeasured points: 0, or another number.

    If it is far from all others, this is certain, and it becomes NaN. Pits and spikes are as far
    away, but seldom equally high.
    """
    distinct, counts = np.unique(heights[np.isfinite(heights)], return_counts=True)
    if not distinct.size or counts.max() < _FEWEST_HELD:
        return
    low, middle, high = np.quantile(distinct, (0.25, 0.5, 0.75))
    far = np.where(np.abs(distinct - middle) > _FAR * (high - low), counts, 0)
    held, count = distinct[np.argmax(far)], far.max()
    if _FEWEST_HELD <= count < heights.size / 2 and 2 * count > far.sum():
        heights[heights == held] = np.nan
        message = (
            "%s: %d points share the height %g µm, far from all others: taken as unmeasured"
        )
        _log.warning(message, path, count, held * 1e3)
        return
    second, most = np.sort([0, *counts])[-2:]
    if most > max(_HELD_FRACTION * heights.size, _HELD_TIMES * second):
        _log.warning(
            "%s: %.3g %% of the points have one height, %g µm. If that stands for unmeasured "
            "points, export them as empty cells or NaN",
            path,
            100 * most / heights.size,
            distinct[np.argmax(counts)] * 1e3,
        )


def _check_plausible(path: Path, heights: np.ndarray, spacing: Sequence[float]) -> None:
    """Refuse a map that no profilometer can have measured."""
    (ny, nx), (dy, dx) = heights.shape, spacing
    if min(ny, nx) < 2:
        raise InputError(path, f"holds {ny} × {nx} points, not a map", "Export the whole map.")
    if not np.isfinite(heights).any():
        raise InputError(path, "not one point is measured", "Measure the patch again.")
    extent = float(np.nanmax(heights) - np.nanmin(heights))
    if (
        not all(_SMALLEST_SPACING <= step <= _LARGEST_SPACING for step in spacing)
        or max(ny * dy, nx * dx) > _LARGEST_FIELD
        or extent > _LARGEST_RANGE
    ):
        raise InputError(
            path,
            f"{nx} × {ny} points every {dx:.4g} × {dy:.4g} mm, whose heights range over "
            f"{extent:.4g} mm, are not a surface scan: its unit is wrong, or unmeasured points are "
            "stored as a number",
            "Check scans.unit in the config, and the instrument's export.",
        )
