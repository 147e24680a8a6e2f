"""Did use smooth the patches or roughen them? Texture before and after, patch by patch."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gstlib.figures.style import (
    BLUE,
    GREY,
    VERMILION,
    WIDTH,
    name_patches,
    new_figure,
    styled,
    write_notes,
)

__all__ = ["texture_figure"]

# Those that single points do not rule, with what a reader may call them.
_SHOWN = {
    "Sq_um": "Sq, mean roughness (µm)",
    "Sk_um": "Sk, core height (µm)",
    "Spk_um": "Spk, summits (µm)",
    "Svk_um": "Svk, dales (µm)",
    "Sal_um": "Sal, grain (µm)",
    "Str": "Str (1: no direction)",
}


@styled
def texture_figure(table: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """Six texture parameters of every patch at T0, and where they went by T1.

    Parameters
    ----------
    table : pandas.DataFrame
        ``texture.csv``: ``patch, epoch`` (``T0``, ``T1``, ``change``) and the parameters.
    """
    before, after = (table[table["epoch"] == epoch].set_index("patch") for epoch in ("T0", "T1"))
    figure = new_figure(WIDTH, 0.92 * WIDTH)
    for axes, (column, label) in zip(figure.subplots(3, 2).flat, _SHOWN.items(), strict=True):
        _changes(axes, before[column], after[column].reindex(before.index))
        axes.set_ylabel(label)
    figure.legend(
        handles=[
            Line2D([], [], marker="o", ls="none", mfc="white", color=GREY, label="T0"),
            Line2D([], [], marker="o", color=BLUE, label="T1, lower"),
            Line2D([], [], marker="o", color=VERMILION, label="T1, higher"),
        ],
        loc="outside upper center",
        ncols=3,
    )
    write_notes(figure, source_note, ["Both over the same area; without T1: the whole scan."])
    return figure


def _changes(axes: Axes, before: pd.Series, after: pd.Series) -> None:
    """An open point for each patch at T0, and a line to a full one at T1."""
    places = np.arange(len(before))
    for fell, colour in ((True, BLUE), (False, VERMILION)):
        chosen = after.notna().to_numpy() & ((after < before).to_numpy() == fell)
        axes.vlines(places[chosen], before[chosen], after[chosen], color=colour, lw=1.2)
        axes.plot(places[chosen], after[chosen], "o", color=colour, markersize=3.5)
    axes.plot(places, before, "o", mfc="white", color=GREY, markersize=3.5, zorder=3)
    name_patches(axes, before.index, fontsize=5.5)
    axes.margins(x=0.03)
