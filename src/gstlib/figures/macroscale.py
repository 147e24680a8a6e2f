"""The square: its heights, how it is pressed, and the forces under the patches (Figs. 3 to 8).

The square's contact holds ``height`` (y, x), mm, ``pressure`` (step, y, x), MPa, and the load path
(step): ``displacement``, ``mean_pressure``, ``contact_fraction``. Figures are those of the paper.
"""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gstlib.figures import maps, style
from gstlib.figures.style import AMBER, BLACK, BLUE, GREY, MM_TO_UM, styled

__all__ = ["contact_steps_figure", "force_figure", "input_figure", "surface_figure"]

_SQUARE = (3.6, 3.6)
_ROOM = (0.55, 0.25, 0.3, 0.85)


def _height_map(height: xr.DataArray) -> tuple[Figure, Axes]:
    figure, (axes,) = style.panels(1, 1, _SQUARE, _ROOM)
    maps.draw_heights(axes, height)
    return figure, axes


@styled
def input_figure(height: xr.DataArray, patches: pd.DataFrame, *, patch_size_mm: float) -> Figure:
    """Heights of the square (y, x), mm, and where the patches were scanned (Fig. 3).

    `patches` and `patch_size_mm` as of `maps.draw_footprints`.
    """
    figure, axes = _height_map(height)
    maps.draw_footprints(axes, patches, patch_size_mm, colour=BLACK)
    maps.mark_corner(axes)
    return figure


@styled
def surface_figure(height: xr.DataArray, *, title: str) -> Figure:
    """One surface (mm) as its file stores it: columns to the right, rows downwards."""
    figure, axes = _height_map(height)
    axes.invert_yaxis()
    axes.set_title(title)
    return figure


@styled
def contact_steps_figure(contact: xr.Dataset, *, steps: int = 8) -> Figure:
    """Contact as the far-field displacement grows (Fig. 5); last, beside a rigid flat's (Fig. 6).

    `contact` is the square's; of its load steps so many are shown, evenly spread, the last among
    them.
    """
    shown = np.unique(np.linspace(0, contact.sizes["step"] - 1, steps).round().astype(int))
    figure, axes = style.panels(len(shown) + 1, 3, (2.3, 2.3))
    height, pressure = contact["height"], contact["pressure"].values
    for panel, step in zip(axes, shown, strict=False):
        maps.draw_map(panel, height, marks={BLACK: pressure[step] > 0})
        displacement, mean_pressure, share = (
            float(contact[name][step])
            for name in ("displacement", "mean_pressure", "contact_fraction")
        )
        panel.set_title(
            f"displacement {displacement * MM_TO_UM:.1f} µm\n"
            f"{mean_pressure:.3g} MPa, contact {share:.1%}"
        )
    elastic = pressure[-1] > 0
    rigid = (height > height.max() - contact["displacement"][-1]).values
    maps.draw_map(axes[-1], height, marks={BLACK: elastic, AMBER: rigid & ~elastic})
    axes[-1].set_title(
        f"last step: contact {elastic.mean():.1%}\nrigid interpenetration {rigid.mean():.1%}"
    )
    maps.scale_bar(axes[0])
    return figure


@styled
def force_figure(contact: xr.Dataset, pressures: pd.DataFrame, *, patch_size_mm: float) -> Figure:
    """Contact forces at the last step (Fig. 8), and every patch's pressure (Table 1).

    `contact` is the square's; `pressures` is ``patch_pressures.csv`` with the interval of each
    patch, ``low_MPa, high_MPa``.
    """
    figure, (square, bars) = style.panels(2, 2, _SQUARE, _ROOM)
    image = maps.draw_forces(square, contact, ticks=True)
    label = "contact force per element (N), square-root scale"
    maps.colour_bar(square, image, label, below=0.13)
    maps.draw_footprints(square, pressures, patch_size_mm, colour=BLUE)
    displacement = float(contact["displacement"][-1]) * MM_TO_UM
    square.set_title(f"displacement {displacement:.1f} µm", loc="right")
    maps.mark_corner(square)

    places, values = np.arange(len(pressures)), pressures["pressure_MPa"]
    studied = pressures["in_study"]
    bars.bar(places[studied], values[studied], color=BLUE, label="in the study")
    bars.bar(places[~studied], values[~studied], color="none", edgecolor=GREY, label="left out")
    bars.vlines(places, pressures["low_MPa"], pressures["high_MPa"], color=BLACK, linewidth=0.7)
    style.name_patches(bars, list(pressures["patch"]))
    bars.set_ylabel("pressure (MPa), 95 % interval")
    bars.set_title("pressure of every patch")
    bars.legend()
    return figure
