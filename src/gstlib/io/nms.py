"""NanoFocus `.nms` height maps of confocal profilers (µsurf).

The layout is that of two measured maps. Of the libraries that read the format, SurfaceTopography
1.27 takes their field to be a million times as large, and surfalize 0.19 (GPL) puts their zero at
the highest point. How unmeasured points are marked, neither knows: a map that may have some is
refused.
"""

import struct
from pathlib import Path

import numpy as np

from gstlib.errors import InputError

__all__ = ["read_nms"]

_HEADER = 3468  # bytes; the heights follow, and then a picture
_LEVELS, _RANGE, _MARK, _GRID = 8, 16, 32, 1368  # where they stand
_HEIGHTS, _TOP = b"OM_MS_2.0", (1 << 16) - 1
# The lowest and the highest height are one point each; of the measured maps, both have just one.
_MOST_AT_ENDS = 10
_EXPORT = "Export the scan from the instrument's software as .sur or .x3p."


def read_nms(path: Path) -> tuple[np.ndarray, tuple[float, float], float, dict[str, str]]:
    """Read a `.nms`, as a reader of `gstlib.io.scans`.

    Raises
    ------
    InputError
        The file is shorter than its header says, of another version, or has points that may be
        unmeasured.
    """
    content = path.read_bytes()
    levels = content[_LEVELS:_RANGE] == struct.pack("<2I", 0, _TOP)
    if len(content) < _HEADER or not (levels and content[_MARK:].startswith(_HEIGHTS)):
        raise InputError(path, "is not a .nms of version 2.0, or cut off", _EXPORT)
    lowest, highest = struct.unpack_from("<2d", content, _RANGE)
    nx, ny, dx, dy = struct.unpack_from("<2I2d", content, _GRID)  # steps in nm
    if len(content) < _HEADER + 2 * nx * ny:
        problem = f"has not the {nx} × {ny} points that its header states: it is truncated"
        raise InputError(path, problem, "Export or copy the scan again.")
    steps = np.frombuffer(content, "<u2", nx * ny, _HEADER).reshape(ny, nx)
    for end, count in (("lowest", (steps == 0).sum()), ("highest", (steps == _TOP).sum())):
        if count > _MOST_AT_ENDS:
            raise InputError(
                path,
                f"{count} points have the {end} height, and may be unmeasured: how a .nms marks "
                "such points is not known",
                _EXPORT,
            )
    heights = lowest + steps * ((highest - lowest) / _TOP)
    return heights, (dy * 1e-3, dx * 1e-3), 1e-3, {"vendor": "NanoFocus"}
