"""The load point and the radius of the active tool, inferred from the wear."""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from gst.page.figures import maps, style
from gst.page.figures.style import BLACK, BLUE, GREY, VERMILION, styled
from gstlib.use.outcome import strikes_of

__all__ = ["use_figure"]

_BINS = 24
# Uses of which a strike is drawn.
_STRIKES = 500
# Of the radius, what is drawn.
_SHOWN = 0.005, 0.995
_LOSSES = ["loss_um", "predicted_um", "low_um", "high_um"]


@styled
def use_figure(
    use: xr.Dataset,
    table: pd.DataFrame,
    losses: pd.DataFrame | None,
    height: xr.DataArray,
    patches: pd.DataFrame,
    *,
    patch_size_mm: float,
) -> Figure:
    """Strikes and their centre on the square, the radius, and the losses beside their predictions.

    `use` is from `gstlib.use.infer.infer_use`, `table` and `losses` are ``use.csv`` and
    ``predicted_losses.csv``, None where there are grades in place of losses; `height` (y, x), mm,
    is the square's.
    """
    panels = 2 if losses is None else 3
    figure, (square, radius, *others) = style.panels(panels, 2)
    prior = table.set_index("parameter").prior
    maps.draw_map(square, height, ticks=True, **maps.HEIGHTS)
    maps.draw_footprints(square, patches, patch_size_mm, colour=BLACK)
    generator = np.random.default_rng(0)
    chosen = generator.choice(use.sizes["draw"], _STRIKES, p=use.weight.values)
    likely = use.isel(draw=chosen)
    strikes = strikes_of(likely, generator)
    square.plot(*strikes.T, ".", color=VERMILION, markersize=4, alpha=0.25, zorder=2)
    square.plot(likely.x_mm, likely.y_mm, ".", color=BLACK, markersize=2, alpha=0.4)
    point = prior["load_point_x"], prior["load_point_y"]
    square.plot(*point, "P", color=BLUE, markersize=10, markeredgecolor="white")
    square.set_xlim(0, height.x[-1] + height.x[0])
    square.set_ylim(0, height.y[-1] + height.y[0])
    square.set_title("prior (cross); inferred strikes (red) and centre (black)")
    _draw_radius(radius, use, table)
    if losses is not None:
        _draw_losses(others[0], losses)
    return figure


def _draw_radius(axes: Axes, use: xr.Dataset, table: pd.DataFrame) -> None:
    """How likely each radius of the active tool is."""
    axes.set_title("radius of the active tool")
    prior = table.set_index("parameter").prior
    if "radius" not in prior:
        axes.text(0.5, 0.5, "not inferred", ha="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    prior_radius = prior["radius"]
    radii, weights = use.radius_mm.values, use.weight.values
    low, high = np.quantile(radii, _SHOWN, weights=weights, method="inverted_cdf")
    edges = np.geomspace(
        min(low, prior_radius) / 1.5, 1.5 * max(high, prior_radius), _BINS + 1
    )
    axes.hist(radii, edges, weights=weights, color=VERMILION, label="inferred")
    axes.axvline(prior_radius, color=BLUE, label="prior")
    axes.set(xscale="log", xlabel="radius (mm)", ylabel="probability")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.legend()


def _draw_losses(axes: Axes, losses: pd.DataFrame) -> None:
    """The loss of each patch beside what the others predict."""
    axes.set_title("loss, predicted by the other patches")
    measured, predicted, low, high = losses[_LOSSES].to_numpy().T
    axes.vlines(measured, low, high, color=GREY, linewidth=0.8)
    axes.plot(measured, predicted, "o", color=BLUE, markersize=4)
    most = 1.1 * max(measured.max(), predicted.max())
    axes.plot([0, most], [0, most], color=BLACK, linewidth=0.7)
    axes.set_xlim(0, most)
    axes.set_ylim(min(0.0, low.min()), max(most, high.max()))
    axes.set_xlabel("measured mean depth lost (µm)")
    axes.set_ylabel("predicted (µm), 95 % interval")
