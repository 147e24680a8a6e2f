"""Gwyddion Simple Field (.gsf), the one listed format that SurfaceTopography does not read.

A magic line, lines ``name = value``, one to four NUL bytes up to a multiple of four, then float32
heights row by row, in the units that the header names. Gwyddion user guide, "Simple Field Files",
http://gwyddion.net/documentation/user-guide-en/gsf.html.
"""

from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.height_map import SCAN_UNITS, HeightMap, Unsaid, plain_text

__all__ = ["read_gsf"]

_MAGIC = b"Gwyddion Simple Field 1.0\n"
_LONGEST_HEADER = 1 << 16
_LARGEST_SIDE = 1 << 16
_MICRO = {"µm": "um", "μm": "um"}  # micro sign, Greek letter
_AGAIN = "Export the scan again, or correct the file's ending."


def read_gsf(path: Path, unsaid: Unsaid) -> HeightMap:
    """Read a .gsf; see `gstlib.io.scans.read_scan`."""
    content = path.read_bytes()
    header = _header(path, content)
    try:
        nx, ny = int(header["XRes"]), int(header["YRes"])
        sizes = [float(header[name]) for name in ("YReal", "XReal") if name in header]
    except (KeyError, ValueError) as error:
        raise InputError(path, f"its header lacks a size, or a number ({error})", _AGAIN) from error
    if not (0 < nx <= _LARGEST_SIDE and 0 < ny <= _LARGEST_SIDE):
        raise InputError(path, f"its header announces {ny} × {nx} points", _AGAIN)
    begin = content.index(b"\0") // 4 * 4 + 4
    if len(content) != begin + 4 * nx * ny:
        raise InputError(
            path,
            f"{ny} × {nx} points take {begin + 4 * nx * ny} bytes, but the file has "
            f"{len(content)}: it is truncated or damaged",
            _AGAIN,
        )
    heights = np.frombuffer(content, "<f4", nx * ny, begin).reshape(ny, nx).astype(float)
    heights *= _factor(path, header.get("ZUnits"), unsaid)
    if len(sizes) == 2:
        factor = _factor(path, header.get("XYUnits"), unsaid)
        spacing = (sizes[0] * factor / ny, sizes[1] * factor / nx)
    else:
        spacing = unsaid.spacing(path)
    attrs = {"layer": plain_text(header["Title"])} if "Title" in header else {}
    return HeightMap(heights, spacing, attrs)


def _header(path: Path, content: bytes) -> dict[str, str]:
    if not content.startswith(_MAGIC):
        raise InputError(path, "does not begin as a Gwyddion Simple Field does", _AGAIN)
    end = content.find(b"\0", 0, _LONGEST_HEADER)
    if end < 0:
        raise InputError(path, "its header has no end", _AGAIN)
    lines = content[len(_MAGIC) : end].decode("utf-8", "replace").split("\n")
    pairs = (line.split("=", 1) for line in lines if "=" in line)
    return {name.strip(): value.strip() for name, value in pairs}


def _factor(path: Path, unit: str | None, unsaid: Unsaid) -> float:
    if not unit:
        return unsaid.unit_factor(path)
    unit = _MICRO.get(unit, unit)
    if unit not in SCAN_UNITS:
        raise InputError(
            path, f"its unit {unit!r} is no length known here", "Export heights, in metres."
        )
    return SCAN_UNITS[unit]
