"""How often the study claims a relation: where there is one, and where there is none."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gstlib.figures.style import BLUE, GREY, VERMILION, WIDTH, new_figure, styled, write_notes

__all__ = ["power_figure"]

_WORLDS = {
    "summits": (BLUE, "o-", "wear on summits: power"),
    "random": (VERMILION, "s-", "wear placed at random: false claims"),
}
_PAIR = "spearman(pressure_MPa, loss_fraction)"
_FEWER = f"{_PAIR}, neighbours allowed for"
_TITLES = {
    "f1": "one patch: contact on loss (F1)\nagainst shifted contact",
    "mean(f1)": "all patches: mean F1\nagainst shifted contact",
    "gain(roc_auc)": "all patches: ROC-AUC above\nthe best rival's",
    _PAIR: "all patches: pressure and area\nwith loss, patches exchanged",
    _FEWER: "all patches: pressure and area\nwith loss, neighbours allowed for",
}
# Level of the panel over the number of patches: the usual one.
_LEVEL = 0.05


@styled
def power_figure(rates: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """Rate of claims of the tests against the nominal level, and against the number of patches.

    Parameters
    ----------
    rates : pandas.DataFrame
        ``power.csv``: ``test, drawn, wear, level, specimens, rate, low, high``.
    """
    figure = new_figure(WIDTH, 0.68 * WIDTH)
    panels = figure.subplots(2, 3, sharey=True).ravel()
    for axes, (test, title) in zip(panels, _TITLES.items(), strict=False):
        axes.axline((0, 0), slope=1, color=GREY, lw=0.8, zorder=0)
        shown = rates[(rates["test"] == test) & rates["drawn"].isna()]
        _draw_rates(axes, shown, "level")
        axes.set(xlabel="nominal level", xlim=(0, None), ylim=(0, 1.03))
        axes.set_title(title)
    for axes in panels[::3]:
        axes.set_ylabel("rate of claims")
    axes = panels[len(_TITLES)]
    axes.axhline(_LEVEL, color=GREY, lw=0.8, zorder=0)
    fewer = rates[(rates["test"] == _FEWER) & np.isclose(rates["level"], _LEVEL)]
    _draw_rates(axes, fewer.dropna(subset="drawn"), "drawn")
    axes.set_xlabel("patches")
    axes.set_title(f"the same with so many patches,\nat the level {_LEVEL:g}")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    notes = [
        f"{rates['specimens'].max()} specimens, each with either wear. Bars: 95 % intervals.",
        "Grey: claims as often as the level says.",
    ]
    write_notes(figure, source_note, notes)
    return figure


def _draw_rates(axes: Axes, rates: pd.DataFrame, along: str) -> None:
    for wear, (colour, mark, label) in _WORLDS.items():
        shown = rates[rates["wear"] == wear]
        below, above = shown["rate"] - shown["low"], shown["high"] - shown["rate"]
        axes.errorbar(
            shown[along],
            shown["rate"],
            yerr=(below.clip(lower=0), above.clip(lower=0)),
            fmt=mark,
            color=colour,
            elinewidth=0.8,
            label=label,
        )
