"""Heights as a caller has them, an array or an `xarray.DataArray`, and fields given back alike."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import ContactInputError, checked_spacing

__all__ = ["FIELDS", "as_given", "rows_first", "step_of"]

# Unit and long name of each field that is given back.
FIELDS = {
    "pressure": ("MPa", "contact pressure"),
    "gap": ("mm", "gap between the bodies"),
    "depth": ("mm", "height lost by wear"),
}
# Steps between coordinates may differ by this share, and a given spacing from their mean.
_IRREGULAR = 1e-3
# Coordinates that were shifted are rounded in their sixteenth digit, and so is their mean step.
_DIGITS = 15


def as_given(
    heights: Any, spacing: Any
) -> tuple[Any, Any, Callable[[str, np.ndarray], Any]]:
    """Heights (y, x), their spacing, and a function that makes a similar field by name and values.

    The coordinates (mm) of a `DataArray` decide its spacing. Fields of an array are arrays.

    Raises
    ------
    ContactInputError
        The spacing is missing, or differs from the coordinates (see `step_of`), or the heights are
        not in mm.
    """
    if not hasattr(heights, "dims"):
        if spacing is None:
            raise ContactInputError("an array has no spacing: pass spacing (mm)")
        return heights, spacing, lambda name, values: values
    if callable(heights.values):
        raise ContactInputError("heights are a Dataset: give one of its variables")
    if heights.attrs.get("units", "mm") != "mm":
        raise ContactInputError(
            f"heights are in {heights.attrs['units']}: convert them to mm"
        )
    if heights.ndim != 2:
        raise ContactInputError(
            f"heights have the dimensions {heights.dims}, not (y, x)"
        )
    ordered = rows_first(heights)
    stated = (None, None) if spacing is None else checked_spacing(spacing)
    steps = tuple(
        step_of(ordered, *at) for at in zip(ordered.dims, stated, strict=True)
    )

    def like(name: str, values: np.ndarray) -> Any:
        field = ordered.copy(data=values).rename(name).transpose(*heights.dims)
        units, long_name = FIELDS[name]
        field.attrs = {"units": units, "long_name": long_name}
        return field

    return ordered.values, steps, like


def rows_first(field: Any) -> Any:
    """A field, transposed if it is a `DataArray` (x, y), because points and slopes are (y, x)."""
    return (
        field.transpose("y", "x") if getattr(field, "dims", ()) == ("x", "y") else field
    )


def step_of(field: Any, dim: str, stated: Any = None) -> float:
    """Distance (mm) of the coordinates of a `DataArray` or `Dataset` along a dimension.

    `stated` is a spacing that must agree with them, or replaces them if there are none. Their
    attribute ``spacing``, which older files have, must agree, too: xarray keeps it when a surface
    is thinned.

    Raises
    ------
    ContactInputError
        There are fewer than two coordinates. They are not in mm, not finite, uneven or decreasing.
        A given spacing differs from theirs by more than a thousandth.
    """
    if dim not in field.coords:
        if stated is None:
            raise ContactInputError(
                f"the dimension {dim} has no coordinates (mm): give them"
            )
        return float(stated)
    axis = field.coords.variables[dim]  # in half the time of field[dim]
    if (units := axis.attrs.get("units", "mm")) != "mm":
        raise ContactInputError(f"the coordinate {dim} is in {units}: convert it to mm")
    step = _mean_step(dim, axis.values)
    for source, spacing in {
        "the argument `spacing`": stated,
        "its attribute `spacing`": axis.attrs.get("spacing"),
    }.items():
        if spacing is not None and not abs(float(spacing) - step) <= _IRREGULAR * step:
            raise ContactInputError(
                f"the coordinate {dim} steps by {step:.6g} mm, but {source} is {spacing} mm: "
                "leave that out, or correct the coordinate"
            )
    return step


def _mean_step(dim, values):
    """Mean step of the values of a coordinate, which must rise in even steps."""
    is_numeric = values.ndim == 1 and values.dtype.kind in "iuf"
    if not is_numeric or values.size < 2 or not np.isfinite(values).all():
        raise ContactInputError(
            f"the coordinate {dim} must be at least two finite numbers (mm): give at least two "
            "rows and two columns, or an array and its spacing"
        )
    values = values.astype(float)
    mean = float(values[-1] - values[0]) / (values.size - 1)
    off = np.abs(np.diff(values) - mean)
    if not (mean > 0 and off.max() <= _IRREGULAR * mean):
        at = int(off.argmax())
        raise ContactInputError(
            f"the coordinate {dim} must rise in even steps: it goes from {values[at]:.6g} to "
            f"{values[at + 1]:.6g} mm at index {at}, and its mean step is {mean:.6g} mm. Sort it "
            f"with .sortby({dim!r}), or resample the heights onto even coordinates"
        )
    # of a grid that begins at 0, the first centre is half a step without any rounding
    step = 2 * float(values[0])
    if np.array_equal(values, (np.arange(values.size) + 0.5) * step):
        return step
    return float(f"{mean:.{_DIGITS}g}")
