"""The load point and the radius of the active tool, inferred from the wear."""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from gst.page.figures import maps, style
from gst.page.figures.style import BLACK, BLUE, GREY, VERMILION
from gst.page.results import Results
from gstlib.use.outcome import strikes_of

_BINS = 24
# Uses of which a strike is drawn.
_STRIKES = 500
# Of the radius, what is drawn.
_SHOWN = 0.005, 0.995


def use_figure(study: Results) -> Figure:
    """Strikes and their centre on the square, the radius, and the losses beside their predictions.

    Where there are grades in place of losses, no losses are drawn.
    """
    use = study.data("use")
    if not use.sizes:
        return style.message_figure(f"How the tool was used {use.answer}.")
    has_losses = "predicted_losses" in study.tables
    figure, (square, radius, *others) = style.panels(2 + has_losses, 2)
    prior = study.table("use").set_index("parameter").prior
    _draw_strikes(square, use, prior, study)
    radius.set_title("radius of the active tool")
    if "radius" in prior:
        _draw_radius(radius, use, prior.radius)
    else:
        radius.text(0.5, 0.5, "not inferred", ha="center", transform=radius.transAxes)
        radius.set_axis_off()
    if has_losses:
        _draw_losses(others[0], study.table("predicted_losses"))
    return figure


def _draw_strikes(
    axes: Axes, use: xr.Dataset, prior: pd.Series, study: Results
) -> None:
    """Strikes and their centre, over the heights of the square and the patches."""
    maps.draw_heights(axes, study.square("surface", "height").height)
    maps.draw_footprints(axes, study.outlined, study.patch_mm, colour=BLACK)
    limits = axes.axis()
    generator = np.random.default_rng(0)
    chosen = generator.choice(use.sizes["draw"], _STRIKES, p=use.weight.values)
    likely = use.isel(draw=chosen)
    x, y = strikes_of(likely, generator).T
    axes.plot(x, y, ".", color=VERMILION, markersize=4, alpha=0.25, zorder=2)
    axes.plot(likely.x_mm, likely.y_mm, ".", color=BLACK, markersize=2, alpha=0.4)
    x, y = prior.load_point_x, prior.load_point_y
    axes.plot(x, y, "P", color=BLUE, markersize=10, markeredgecolor="white")
    axes.axis(limits)
    axes.set_title("prior (cross), inferred strikes (red) and centre (black)")


def _draw_radius(axes: Axes, use: xr.Dataset, prior: float) -> None:
    """How likely each radius of the active tool is."""
    radii, weights = use.radius_mm.values, use.weight.values
    low, high = np.quantile(radii, _SHOWN, weights=weights, method="inverted_cdf")
    edges = np.geomspace(min(low, prior) / 1.5, 1.5 * max(high, prior), _BINS + 1)
    axes.hist(radii, edges, weights=weights, color=VERMILION, label="inferred")
    axes.axvline(prior, color=BLUE, label="prior")
    axes.set(xscale="log", xlabel="radius (mm)", ylabel="probability")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.legend()


def _draw_losses(axes: Axes, losses: pd.DataFrame) -> None:
    """The loss of each patch beside what the others predict."""
    measured, predicted = losses.loss_um, losses.predicted_um
    low, high = losses.low_um, losses.high_um
    axes.vlines(measured, low, high, color=GREY, linewidth=0.8)
    axes.plot(measured, predicted, "o", color=BLUE, markersize=4)
    most = 1.1 * max(measured.max(), predicted.max())
    axes.plot([0, most], [0, most], color=BLACK, linewidth=0.7)
    axes.set(xlim=(0, most), xlabel="measured mean depth lost (µm)")
    axes.set(ylim=(min(0.0, low.min()), max(most, high.max())))
    axes.set_ylabel("predicted (µm), 95 % interval")
    axes.set_title("loss, predicted by the other patches")
