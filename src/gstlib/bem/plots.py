"""Pictures of fields and curves, drawn by xarray and pandas, which load Matplotlib if it is there.

Nothing here or elsewhere in the library imports it.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

from .fields import FIELDS

__all__ = ["plot_curve", "plot_field"]


def plot_field(name: str, values: Any, shown: Any, axes: Any = None) -> Any:
    """Axes with a map of a field (ny, nx), white outside `shown`.

    The map of a `DataArray` is in mm, and otherwise in elements. It is on the current axes unless
    others are given.
    """
    import xarray as xr  # here: solving needs it not

    if not hasattr(values, "dims"):
        values = xr.DataArray(values, dims=("y (elements)", "x (elements)"))
    units, long_name = FIELDS[name]
    field = values.where(shown).assign_attrs(units=units, long_name=long_name)
    axes = field.plot.imshow(ax=axes).axes
    axes.set_aspect("equal")
    return axes


def plot_curve(table: "pd.DataFrame", x: str, y: str, axes: Any = None) -> Any:
    """Axes with a column of a table over another, by default new axes."""
    return table.plot(x=x, y=y, ylabel=y, style=".-", legend=False, ax=axes)
