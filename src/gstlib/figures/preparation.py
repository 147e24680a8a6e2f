"""How the scans were cleaned: before, after, what was changed, and what each rule finds."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gstlib.figures.style import (
    AMBER,
    BLUE,
    CONTACT,
    GREY,
    MM_TO_UM,
    PALE,
    VERMILION,
    WIDTH,
    block_of,
    draw_classes,
    draw_heights,
    height_limits,
    scale_bar,
    styled,
)

__all__ = ["preparation_figure"]

# Inches. There is a figure for every patch: laid out by hand, each takes a third of the time.
_MAP, _GAP, _LEFT = 1.62, 0.09, 0.05
_HISTOGRAM = 1.3
_TITLE, _LEGEND, _TOP, _BOTTOM = 0.34, 0.5, 0.24, 0.2


@styled
def preparation_figure(
    prepared: Mapping[str, xr.Dataset],
    measured: Mapping[str, xr.DataArray],
    *,
    patch: str,
    source_note: str | None = None,
) -> Figure:
    """A patch's scans as measured and as prepared, and what was changed; one row an epoch.

    Parameters
    ----------
    prepared : mapping of epoch to xarray.Dataset
        As of `prepare_scan`.
    measured : mapping of epoch to (y, x) xarray.DataArray
        The same scans as measured, turned back from the mould, mm, NaN where unmeasured.
    patch : str
        Its id, for the title.
    """
    row = _TITLE + _MAP + _LEGEND
    height = _TOP + len(prepared) * row + _BOTTOM
    figure = Figure(figsize=(WIDTH, height))
    FigureCanvasAgg(figure)
    block = 1
    for number, (epoch, surface) in enumerate(prepared.items()):
        bottom = height - _TOP - number * row - _TITLE - _MAP
        lefts = [_LEFT + column * (_MAP + _GAP) for column in range(3)]
        boxes = [(left, bottom, _MAP, _MAP) for left in lefts]
        boxes.append((WIDTH - _HISTOGRAM - _LEFT, bottom, _HISTOGRAM, _MAP))
        axes = [
            figure.add_axes((left / WIDTH, low / height, wide / WIDTH, high / height))
            for left, low, wide, high in boxes
        ]
        block = block_of(surface["height"].shape, _MAP)
        _draw_measured(axes[0], epoch, measured[epoch], surface, block)
        _draw_prepared(axes[1], epoch, surface)
        _draw_rules(axes[2], surface, block)
        _height_histogram(axes[3], measured[epoch], surface["height"])
    figure.text(0.5, 1 - 0.04 / height, f"patch {patch}", ha="center", va="top", fontsize=9)
    notes = ["Highest: above the mean plane; Sq as measured holds the tilt."]
    if block > 1:
        notes.append(f"Marks are at least {block} points wide, so that none is lost.")
    style = {"fontsize": 6.5, "color": GREY, "va": "bottom"}
    figure.text(0.008, 0.03 / height, " ".join(notes), ha="left", **style)
    if source_note:
        figure.text(0.992, 0.03 / height, source_note, ha="right", style="italic", **style)
    return figure


def _draw_measured(
    axes: Axes, epoch: str, measured: xr.DataArray, surface: xr.Dataset, block: int
) -> None:
    attrs = surface.attrs
    colours = _draw_colours(axes, measured)
    classes = [
        ("unmeasured", surface["filled"].values, BLUE),
        ("outliers", surface["outlier"].values, VERMILION),
    ]
    _mark(axes, surface, classes, block)
    # a quarter of the map, to one digit: 0.2 mm of 0.85
    scale_bar(axes, float(f"{0.24 * np.ptp(axes.get_xlim()):.0e}"))
    axes.set_title(
        f"{epoch} as measured\n"
        f"Sq {attrs['Sq_before_um']:.3g}, highest {attrs['highest_before_um']:.3g} µm",
        fontsize=7,
    )
    _write_below(axes, 2, colours)


def _draw_prepared(axes: Axes, epoch: str, surface: xr.Dataset) -> None:
    attrs = surface.attrs
    colours = _draw_colours(axes, surface["height"])
    axes.set_title(
        f"{epoch} prepared\n"
        f"Sq {attrs['Sq_after_um']:.3g}, highest {attrs['highest_after_um']:.3g} µm",
        fontsize=7,
    )
    _write_below(axes, 0, f"tilt taken off, x: {attrs['tilt_x_mrad']:.3g} mrad")
    _write_below(axes, 1, f"tilt taken off, y: {attrs['tilt_y_mrad']:.3g} mrad")
    _write_below(axes, 2, colours)


def _draw_rules(axes: Axes, surface: xr.Dataset, block: int) -> None:
    window, median = (surface[f"outlier_{rule}"].values for rule in ("window", "median"))
    draw_heights(axes, surface["height"], relief=True, ticks=False)
    classes = [
        ("both rules", window & median, VERMILION),
        ("window only", window & ~median, AMBER),
        ("median only", median & ~window, CONTACT),
    ]
    _mark(axes, surface, classes, block)
    attrs = surface.attrs
    axes.set_title(
        f"outliers (replaced: {attrs['outlier_rule']})\n"
        f"window: k {attrs['outlier_k_window']:.3g}, median: {attrs['outlier_k_median']:.3g} σ",
        fontsize=7,
    )


def _draw_colours(axes: Axes, heights: xr.DataArray) -> str:
    """Draw heights; what the ends of the colours stand for."""
    low, high = height_limits(heights)
    draw_heights(axes, heights, limits=(low, high), ticks=False)
    return f"colours: {low:.3g} to {high:.3g} µm"


def _write_below(axes: Axes, line: int, text: str) -> None:
    """A line of small print under a map, in step with those of a legend."""
    axes.text(0.06, -0.035 - 0.085 * line, text, transform=axes.transAxes, va="top", fontsize=6.5)


def _mark(
    axes: Axes, surface: xr.Dataset, classes: Sequence[tuple[str, np.ndarray, str]], block: int
) -> None:
    """Mark points over a map, with their number and share under it."""
    draw_classes(axes, surface["height"], {c: mask for _, mask, c in classes}, block=block)
    handles = [
        Patch(color=colour, label=f"{name}: {np.count_nonzero(mask)} ({mask.mean():.2%})")
        for name, mask, colour in classes
    ]
    axes.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.0, 0.0),
        handlelength=1,
        borderaxespad=0.3,
        labelspacing=0.4,
        fontsize=6.5,
    )


def _height_histogram(axes: Axes, measured: xr.DataArray, height: xr.DataArray) -> None:
    before = measured.values[np.isfinite(measured.values)] * MM_TO_UM
    after = height.values.ravel() * MM_TO_UM
    before = before - np.median(before)
    low, high = min(before.min(), after.min()), max(before.max(), after.max())
    bins = np.linspace(low, high if high > low else low + 1, 80)
    axes.hist(before, bins, color=PALE, edgecolor=GREY, histtype="stepfilled", label="measured")
    axes.hist(after, bins, color=BLUE, histtype="step", label="prepared")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_title("number of points", fontsize=7)
    axes.set_xlabel("height (µm)", fontsize=7)
    axes.tick_params(labelsize=6)
    axes.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, handlelength=1)
