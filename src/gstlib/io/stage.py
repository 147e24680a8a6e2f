"""Where an instrument's stage stood when it measured a map, as some files state it.

A stage is read in its own frame. Its zero, the directions of its axes and which point of the map it
names (corner or centre) differ between instruments, and no file states them: of maps of one size
that were measured without taking the stone off, only the distances count.
"""

import xarray as xr

__all__ = ["stage_attrs", "stage_of"]

# No stage moves farther (mm): larger numbers stand for something else.
_FARTHEST = 1000.0
# Digits that a single-precision number has.
_DIGITS = 7


def stage_attrs(x: float, y: float, length_mm: float) -> dict[str, str]:
    """Attributes of a scan (text) for a place in units of `length_mm`; none if it is no place.

    Two zeros are what is written where nothing is known.

    >>> stage_attrs(-52.16, -6042.68, 1e-3)
    {'stage_x_mm': '-0.05216', 'stage_y_mm': '-6.04268'}
    """
    place = {"stage_x_mm": x * length_mm, "stage_y_mm": y * length_mm}
    is_near = all(abs(at) <= _FARTHEST for at in place.values())  # and no NaN
    if not is_near or not any(place.values()):
        return {}
    return {name: f"{at:.{_DIGITS}g}" for name, at in place.items()}


def stage_of(scan: xr.DataArray) -> tuple[float, float] | None:
    """The stage's place (x, y) in mm of a scan from `gstlib.io.scans.read_scan`, if it has one."""
    attrs = scan.attrs
    if "stage_x_mm" not in attrs:
        return None
    return float(attrs["stage_x_mm"]), float(attrs["stage_y_mm"])
