"""What the readers of maps return; and the position of the stage, from files that contain it.

A stage is read in its own frame. Its zero, its directions, and its point of the map (corner or
centre) differ between instruments, and files do not contain them. Only distances count, between
maps of one size that were measured without moving the stone on the stage.
"""

from typing import TypeAlias

import numpy as np
import xarray as xr

__all__ = ["RawMap", "stage_attrs", "stage_of"]

# Heights and spacing in the file's unit, the length of this unit in mm, and attributes. See
# `gstlib.io.scans`.
RawMap: TypeAlias = tuple[
    np.ndarray, tuple[float, float] | None, float | None, dict[str, str]
]

# No stage moves farther (mm). Larger numbers mean something else.
_FARTHEST = 1000.0
# Digits that a single-precision number has.
_DIGITS = 7


def stage_attrs(x: float, y: float, length_mm: float) -> dict[str, str]:
    """Attributes of a scan (text) for a position in units of `length_mm`; empty if invalid.

    Two zeros are written if the position is unknown.

    >>> stage_attrs(-52.16, -6042.68, 1e-3)
    {'stage_x_mm': '-0.05216', 'stage_y_mm': '-6.04268'}
    """
    place = {"stage_x_mm": x * length_mm, "stage_y_mm": y * length_mm}
    is_near = all(abs(at) <= _FARTHEST for at in place.values())  # and no NaN
    if not is_near or not any(place.values()):
        return {}
    return {name: f"{at:.{_DIGITS}g}" for name, at in place.items()}


def stage_of(scan: xr.DataArray) -> tuple[float, float] | None:
    """The stage's position (x, y) in mm of a scan from `gstlib.io.scans.read_scan`, if any."""
    attrs = scan.attrs
    if "stage_x_mm" not in attrs:
        return None
    return float(attrs["stage_x_mm"]), float(attrs["stage_y_mm"])
