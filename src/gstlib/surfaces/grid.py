"""The data type of the study: heights on a regular grid.

A surface is an `xarray.DataArray` with dimensions ``("y", "x")``. Coordinates ``y`` and ``x`` are
the element centres in mm, both increasing in even steps. Heights are float64 in mm, positive out of
the stone; unmeasured elements are NaN. A surface of n elements is n spacings long.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from gstlib.bem.errors import ContactInputError, checked_spacing
from gstlib.bem.fields import as_given, step_of

__all__ = [
    "MM_TO_UM",
    "axis_coordinates",
    "coarser",
    "described",
    "make_surface",
    "spacing_of",
    "spacing_of_heights",
]

MM_TO_UM = 1e3


def axis_coordinates(count: int, spacing: float) -> np.ndarray:
    """Centres (mm) of `count` elements of length `spacing`, the first one beginning at 0."""
    return (np.arange(count) + 0.5) * spacing


def make_surface(
    heights: np.ndarray | xr.DataArray,
    spacing: float | Sequence[float],
    *,
    long_name: str = "surface height",
    **attrs: str | float,
) -> xr.DataArray:
    """A surface from an array of heights.

    Parameters
    ----------
    heights : (ny, nx) array_like
        Heights in mm, positive out of the stone, NaN or masked where unmeasured. A `DataArray` is
        moved so that its first element begins at 0.
    spacing : float or (dy, dx)
        Element size in mm. For a `DataArray` it must agree with the coordinates.
    long_name : str
        Its description. Further attributes may follow.

    Examples
    --------
    >>> import gstlib
    >>> surface = gstlib.make_surface([[0.0, 0.1, 0.2], [0.3, 0.4, 0.5]], spacing=(1.0, 0.25))
    >>> surface.y.values, surface.x.values
    (array([0.5, 1.5]), array([0.125, 0.375, 0.625]))
    """
    given = as_given(heights, spacing)[0]
    values: np.ndarray = np.ma.asarray(given, dtype=float).filled(np.nan)
    if values.ndim != 2:
        raise ValueError(f"a surface has 2 dimensions, not {values.ndim}")
    steps = checked_spacing(spacing)
    coords = {}
    for axis, count, step in zip("yx", values.shape, steps, strict=True):
        attrs_of_axis = {"units": "mm", "long_name": f"{axis} position"}
        coords[axis] = (axis, axis_coordinates(count, step), attrs_of_axis)
    return xr.DataArray(
        values,
        dims=("y", "x"),
        coords=coords,
        name="height",
        attrs={"units": "mm", "long_name": long_name, **attrs},
    )


def spacing_of(surface: xr.DataArray | xr.Dataset) -> tuple[float, float]:
    """Element size (dy, dx) in mm, from the coordinates.

    Raises
    ------
    ContactInputError
        The coordinates y or x are missing, uneven or falling, not in mm, or of a single element.
    ValueError
        A field has x before y among its dimensions.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> surface = gstlib.make_surface(np.zeros((6, 8)), spacing=(1.0, 0.25))
    >>> gstlib.spacing_of(surface[:, ::2])
    (1.0, 0.5)
    """
    fields = (
        surface.data_vars.values() if isinstance(surface, xr.Dataset) else [surface]
    )
    for field in fields:
        dims = field.dims
        if "y" in dims and "x" in dims and dims.index("x") < dims.index("y"):
            remedy = "give y before x, by .transpose('y', 'x')"
            raise ValueError(f"the dimensions are {dims}: {remedy}")
    return step_of(surface, "y"), step_of(surface, "x")


def spacing_of_heights(heights: xr.DataArray) -> tuple[float, float]:
    """As `spacing_of`, and refuses heights in another unit than mm."""
    units = heights.attrs.get("units", "mm")
    if units != "mm":
        raise ContactInputError(f"heights are in {units}: convert them to mm")
    return spacing_of(heights)


def coarser(surface: xr.DataArray, times: int) -> xr.DataArray:
    """A surface on elements so many times as long, each the mean of its measured elements."""
    means = surface.coarsen(y=times, x=times, boundary="trim").mean()
    return means.assign_attrs(surface.attrs)


def described(
    dataset: xr.Dataset, meanings: Mapping[str, tuple[str, str]]
) -> xr.Dataset:
    """A dataset with the unit and the long name of every variable, from `meanings` by name."""
    for name in dataset.data_vars:
        units, long_name = meanings[str(name)]
        dataset[name].attrs = {"units": units, "long_name": long_name}
    return dataset
