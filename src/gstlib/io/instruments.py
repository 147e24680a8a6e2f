"""Files of instruments, read through SurfaceTopography once they are seen to be whole.

It reads heights at the offset in the header and ignores the bytes behind them. A byte that was
added before the heights therefore shifts them all. If a format defines the bytes that follow its
heights, they are checked here.
"""

import functools
import io
import logging
import math
import re
import warnings
import zipfile
import zlib
from pathlib import Path
from struct import unpack_from
from typing import Any

import h5py
import numpy as np

from gstlib.errors import NOTE, InputError
from gstlib.io.containers import check_hdf5, check_unpacked_size, plain_zip
from gstlib.io.files import UnreadableError
from gstlib.io.stage import RawMap, stage_attrs
from gstlib.io.x3p import read_x3p

__all__ = ["instrument_endings", "plain_text", "read_instrument_file"]

_log = logging.getLogger(__name__)

# Formats for which SurfaceTopography is not used. Text is read more strictly here. Its `hgt` reader
# does not check a signature and takes any bytes for heights. Its `nms` reader makes the field a
# million times as large.
_NOT_LEFT = {"asc", "hgt", "nms", "plu", "xyz"}
# Formats of arrays, whose rows are the rows of the map. They do not state which array has heights.
_ARRAYS = {"h5", "mat", "npy", "npz"}
_MOST_POINTS = 1 << 26
# Measured heights take at least half a byte each, however packed. A small map may be empty.
_POINTS_PER_BYTE, _FEW_POINTS = 2, 1 << 22
_LONGEST_TEXT = 200
_AS_MEASURED = (
    "%s: an .mnt contains the map as measured, without any levelling, shift or extraction in "
    "Mountains. Save the processed map as .sur"
)
# Content behind the heights of a `.sur`: a further object, if anything.
_SUR_MARKS = b"DIGITAL SURF", b"DSCOMPRESSED"
_SUR_END = re.compile(rb"DIGITAL SURF|DSCOMPRESSED|\Z")
_SUR_HEADER = 512
# Kinds without heights: binary, intensity and colour images, spectra.
_SUR_NO_HEIGHTS = {3, 10, 12, 20, 21}
# Unmeasured heights are 2 below the lowest. Saturated heights are 1 below it or above the highest.
_SUR_BELOW, _SUR_ABOVE = 2, 1
# Units of a `.sur`, in Latin-1. Some programs write µ, or the Greek letter, in UTF-8.
_SUR_UNITS = slice(180, 276)
_MICRO, _OTHER_MICRO = b"\xb5m\0", ("µm".encode(), "μm".encode())
# The mark and the size of the header of a binary .sdf, and the bytes of a height of each type.
_SDF_MARK, _SDF_HEADER, _SDF_SIZES = b"bISO-1.0", 81, (1, 2, 4, 4, 1, 2, 4, 8)
# Content behind its heights: lines `name = value`, or tags.
_SDF_END = re.compile(rb"\s*(<\s*[A-Za-z]|[A-Za-z]\w*\s*=|\x1a|$)")
_NO_HEIGHTS = "it does not contain a map of heights"
_COPY_AGAIN = "Copy the file, or export the scan, again."
_OWN_FORMAT = (
    "Export the scan in the instrument's own format (.plu, .plux, .al3d, .sur, ...)."
)


def read_instrument_file(path: Path) -> RawMap:
    """Read the first height map of a file, as a reader of `gstlib.io.scans`.

    SurfaceTopography returns heights as [ix, iy], but arrays as they are, in a unit that differs
    between files (Röttger et al. 2022, Surf. Topogr.: Metrol. Prop. 10:035032).
    """
    try:
        with warnings.catch_warnings():
            # about odd dates and numbers; important values are checked
            warnings.simplefilter("ignore")
            is_x3p = path.suffix.lower() == ".x3p"
            return read_x3p(path) if is_x3p else _first_map(path)
    except InputError:
        raise
    # the readers raise whatever their parsers raise, and MemoryError for a size that is too large
    except Exception as error:
        reason = plain_text(f"{type(error).__name__}: {error} {error.__cause__ or ''}")
        raise UnreadableError(
            f"cannot be read as a height map ({reason}): it is damaged or in another format",
            _OWN_FORMAT,
        ) from error


def plain_text(value: str) -> str:
    """One short line of printable text: HDF5 attributes exclude NUL and lone surrogates."""
    text = value.encode("utf-8", "replace").decode("utf-8")
    printable = "".join(c if c.isprintable() else " " for c in text)
    return " ".join(printable.split())[:_LONGEST_TEXT]


@functools.cache
def instrument_endings() -> dict[str, str]:
    """SurfaceTopography's name of the format of each ending; empty if it is not installed."""
    try:  # here, for its import takes a second or two
        from SurfaceTopography.IO import readers
    except ImportError:
        return {}
    return {
        f".{ending}": reader.format()
        for reader in readers
        for ending in reader.file_extensions()
        if reader.format() not in _NOT_LEFT
    }


def _first_map(path: Path) -> RawMap:
    """The first height map of a file in a format of SurfaceTopography."""
    formats = instrument_endings()
    if not formats:
        raise UnreadableError(
            "cannot be read: SurfaceTopography, which reads its format, is not installed",
            "Install it: pip install 'gstlib[formats]'",
        )
    if (known_as := formats.get(path.suffix.lower())) is None:
        raise UnreadableError(
            f"cannot be read as a height map: the ending '{path.suffix}' is unknown",
            _OWN_FORMAT,
        )
    from SurfaceTopography.IO import open_topography

    reader = open_topography(_checked(path), format=known_as)
    maps = [c for c in reader.channels if c.dim == 2 and c.is_height_channel]
    if not maps:
        raise ValueError(_NO_HEIGHTS)
    channel, *others = maps
    if others and known_as in _ARRAYS:
        names = ", ".join(str(each.name) for each in maps)
        raise UnreadableError(
            f"has {len(maps)} arrays ({names:.80}), any of which may be the heights",
            "Save the heights alone in a file.",
        )
    count = math.prod(channel.nb_grid_pts)
    most = max(_FEW_POINTS, _POINTS_PER_BYTE * path.stat().st_size)
    if count > min(_MOST_POINTS, most):
        raise ValueError(f"it announces {count} points, more than it can contain")
    stated = channel.physical_sizes is not None
    sizes = {} if stated else {"physical_sizes": (1.0, 1.0)}
    topography = channel.topography(**sizes)
    masked: np.ma.MaskedArray = np.ma.asarray(topography.heights(), dtype=float)
    heights: np.ndarray = masked.filled(np.nan)
    if heights.shape != tuple(channel.nb_grid_pts):
        raise ValueError(f"{heights.size} points instead of the {count} announced")
    if known_as not in _ARRAYS:
        heights = heights.T
    (ny, nx), (size_x, size_y) = heights.shape, topography.physical_sizes
    spacing = (float(size_y) / ny, float(size_x) / nx) if stated else None
    unit = topography.unit
    length = None if unit is None else _millimetres(unit)
    if known_as == "mnt":
        _log.log(NOTE, _AS_MEASURED, path)
    attrs = _attributes(known_as, topography.info)
    if others:
        attrs["layer"] = f"{channel.name}, the first of {len(maps)} height maps"
    return heights, spacing, length, attrs


def _attributes(known_as: str, info: Any) -> dict[str, str]:
    """The instrument, the time and the position of the stage, as far as the file has them."""
    instrument = info.get("instrument") or {}
    attrs = {
        "instrument": instrument.get("name"),
        "vendor": instrument.get("vendor"),
        "acquired": info.get("acquisition_time"),
    }
    stated = {name: str(value) for name, value in attrs.items() if value is not None}
    header = info.get("raw_metadata")
    if known_as == "os3d":
        return stated | stage_attrs(header["origin_x"], header["origin_y"], 1e-3)
    if known_as == "sur":
        units = header["x_unit"], header["y_unit"]
        # steps in another unit: the unit of the offsets is not in the header
        if units == (header["delta_x_unit"], header["delta_y_unit"]):
            x, y = map(_millimetres, units)
            place = stage_attrs(x * header["x_offset"], y * header["y_offset"], 1.0)
            return stated | place
    return stated


def _millimetres(unit: str) -> float:
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    return get_unit_conversion_factor(unit, "mm")


def _checked(path: Path) -> str | io.BytesIO:
    """A file that is not seen to be damaged, in the form that SurfaceTopography reads."""
    with path.open("rb") as file:
        mark = file.read(len(_SUR_MARKS[0]))
    if mark in _SUR_MARKS:
        return io.BytesIO(_plain_sur(path.read_bytes()))
    if mark.startswith(_SDF_MARK):
        _check_sdf(path.read_bytes())
    if zipfile.is_zipfile(path):
        return plain_zip(path)
    if h5py.is_hdf5(path):
        with h5py.File(path) as stored:
            check_hdf5(path, stored)
    return str(path)


def _plain_sur(content: bytes) -> bytes:
    """A `.sur` without compression, with the micro signs of its units in Latin-1."""
    (kind,) = unpack_from("<H", content, 18)
    if kind in _SUR_NO_HEIGHTS:
        raise ValueError(_NO_HEIGHTS)
    comment, private = unpack_from("<2H", content, 334)
    start = _SUR_HEADER + comment + private
    header, rest = bytearray(content[:start]), content[start:]
    if content.startswith(b"DSCOMPRESSED"):
        header[:12] = b"DIGITAL SURF"
        rest = _unpacked_sur(rest)
    _check_sur(header, rest)
    for other in _OTHER_MICRO:
        header[_SUR_UNITS] = header[_SUR_UNITS].replace(other, _MICRO)
    return bytes(header) + rest


def _unpacked_sur(packed: bytes) -> bytes:
    """Heights of a compressed `.sur`, and the bytes behind them."""
    (streams,) = unpack_from("<I", packed)
    sizes = np.frombuffer(packed, "<u4", 2 * streams, 4).reshape(-1, 2).tolist()
    check_unpacked_size(len(packed), sum(size for size, _ in sizes))
    heights = b""
    at = 4 + 8 * streams
    for size, length in sizes:
        stream = zlib.decompressobj()
        # read no more than the stated size, and one byte that shows the end of the stream
        part = stream.decompress(packed[at : at + length], size + 1)
        if len(part) != size or not stream.eof:
            raise UnreadableError(
                f"its heights do not unpack to {size} bytes", _COPY_AGAIN
            )
        heights += part
        at += length
    return heights + packed[at:]


def _check_sur(header: bytearray, rest: bytes) -> None:
    """Refuse heights beyond the stated range, or followed by odd bytes."""
    bits, lowest, highest, nx, ny = unpack_from("<H4i", header, 98)
    heights = np.frombuffer(rest, f"<i{bits // 8}", nx * ny)
    _check_end(rest[heights.nbytes :], _SUR_END)
    low, high = int(heights.min(initial=highest)), int(heights.max(initial=lowest))
    is_within = lowest - _SUR_BELOW <= low and high <= highest + _SUR_ABOVE
    if lowest < highest and not is_within:  # some programs may state neither
        raise UnreadableError(
            f"holds heights from {low} to {high}, but states {lowest} to {highest} "
            "(steps of the file): it is damaged",
            _COPY_AGAIN,
        )


def _check_sdf(content: bytes) -> None:
    """Refuse a binary `.sdf` with anything but text behind its heights."""
    nx, ny = unpack_from("<2H", content, 42)
    end = _SDF_HEADER + nx * ny * _SDF_SIZES[content[79]]
    _check_end(content[end:], _SDF_END)


def _check_end(behind: bytes, pattern: re.Pattern[bytes]) -> None:
    """Refuse bytes behind the heights that the format does not define."""
    if not pattern.match(behind):
        raise UnreadableError(
            f"{len(behind)} unexpected bytes follow its heights: bytes were added, or the heights "
            "begin elsewhere",
            f"{_COPY_AGAIN} If that does not help, export it as .x3p or .plux.",
        )
