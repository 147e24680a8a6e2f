"""What goes in: the square with its patches (the paper's Fig. 3), and any surface by itself."""

import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from gstlib.figures.macroscale import draw_footprints, mark_origin
from gstlib.figures.style import WIDTH, draw_heights, new_figure, styled, write_notes

__all__ = ["input_figure", "surface_figure"]


@styled
def input_figure(
    height: xr.DataArray,
    patches: pd.DataFrame,
    *,
    patch_size_mm: float,
    source_note: str | None = None,
) -> Figure:
    """Heights of the square and where the patches were scanned (Fig. 3).

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        Levelled heights of the square, mm, in the square's frame.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm``, optionally ``rotation_deg``.
    patch_size_mm : float
        Side of a patch.
    source_note : str, optional
        Where the data comes from, written in the corner of the figure.
    """
    figure = new_figure(0.72 * WIDTH, 0.66 * WIDTH)
    axes = figure.subplots()
    image = draw_heights(axes, height)
    figure.colorbar(image, ax=axes, label="height (µm)", shrink=0.9)
    draw_footprints(axes, patches, patch_size_mm, colour="white", label_all=True)
    mark_origin(axes)
    write_notes(figure, source_note)
    return figure


@styled
def surface_figure(height: xr.DataArray, *, title: str) -> Figure:
    """One surface (mm) as it lies in its file: columns to the right, rows downwards."""
    figure = new_figure(0.72 * WIDTH, 0.66 * WIDTH)
    axes = figure.subplots()
    image = draw_heights(axes, height)
    axes.invert_xaxis()
    axes.set_title(title)
    figure.colorbar(image, ax=axes, label="height (µm)", shrink=0.9)
    return figure
