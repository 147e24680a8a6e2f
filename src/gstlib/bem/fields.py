"""Heights as a caller has them, an array or an `xarray.DataArray`, and fields given back alike."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import ContactInputError

__all__ = ["FIELDS", "as_given"]

# Unit and long name of each field that is given back.
FIELDS = {
    "pressure": ("MPa", "contact pressure"),
    "gap": ("mm", "gap between the bodies"),
    "depth": ("mm", "height lost by wear"),
}
# Coordinates may be off a regular grid by this share of their spacing.
_IRREGULAR = 1e-3


def as_given(heights: Any, spacing: Any) -> tuple[Any, Any, Callable[[str, np.ndarray], Any]]:
    """Heights, their spacing, and what makes a field (its name, its values) like the heights.

    A `DataArray` says its own spacing, by its coordinates (mm); of an array fields are arrays.
    """
    if not hasattr(heights, "dims"):
        if spacing is None:
            raise ContactInputError("an array does not say its spacing: give it (mm)")
        return heights, spacing, lambda name, values: values
    if heights.attrs.get("units", "mm") != "mm":
        raise ContactInputError(f"heights are in {heights.attrs['units']}: convert them to mm")
    if spacing is None:
        spacing = tuple(_step(heights[axis]) for axis in heights.dims)

    def like(name: str, values: np.ndarray) -> Any:
        field = heights.copy(data=values).rename(name)
        units, long_name = FIELDS[name]
        field.attrs = {"units": units, "long_name": long_name}
        return field

    return heights.values, spacing, like


def _step(axis):
    """Spacing (mm) of a coordinate: as its attribute says, free of rounding, or as it goes."""
    units = axis.attrs.get("units", "mm")
    if units != "mm":
        raise ContactInputError(f"the coordinate {axis.name} is in {units}: convert it to mm")
    if "spacing" in axis.attrs:
        return float(axis.attrs["spacing"])
    steps = np.diff(axis.values.astype(float))
    if not steps.size or np.ptp(steps) > _IRREGULAR * abs(steps.mean()):
        raise ContactInputError(
            f"the coordinate {axis.name} has no constant step: give spacing"
        )
    return abs(float(steps.mean()))
