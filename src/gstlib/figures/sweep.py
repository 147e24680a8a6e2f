"""What moves the results most: one bar for each value of each factor, the longest on top."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gstlib.figures.style import (
    AMBER,
    BLUE,
    GREY,
    PALE,
    VERMILION,
    WIDTH,
    new_figure,
    styled,
    write_notes,
)

__all__ = ["sweep_figure"]

_TITLES = {
    "relative_change(pressure_MPa)": "pressures of patches: summed change\nover their sum",
    "spearman(pressure_MPa, loss_fraction)": "all patches: rank correlation\nof pressure and loss",
    "mean(f1)": "all patches: mean F1\nof contact on loss",
    "gain(f1)": "all patches: F1 above\nthe best rival's",
    "gain(roc_auc)": "all patches: ROC-AUC above\nthe best rival's",
    "mean_change(Sq_um)": "all patches: mean change\nof Sq in use (µm)",
}
# In the order of a factor's values; two are far apart.
_COLOURS = (BLUE, VERMILION, AMBER)


@styled
def sweep_figure(table: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """Tornado diagrams of the outcomes of a sweep.

    Parameters
    ----------
    table : pandas.DataFrame
        ``sweep.csv``: ``factor, value, output, result, change, low, high``.
    """
    shown = [output for output in _TITLES if (table["output"] == output).any()]
    rows, columns = -(-len(shown) // 2), min(2, len(shown))
    moved = table[table["output"].isin(shown) & (table["change"] != 0)]
    most = moved.groupby("output")["factor"].nunique().max()
    figure = new_figure(WIDTH, rows * (0.7 + 0.22 * most) + 0.2)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, output in zip(panels, shown, strict=False):
        _draw_tornado(axes, table[table["output"] == output], places=most)
        axes.set_title(_TITLES[output])
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    notes = [
        "One factor at a time, its values beside the bars; those without effect are left out.",
        "Line: the study; band: its 95 % interval.",
    ]
    write_notes(figure, source_note, notes)
    return figure


def _draw_tornado(axes: Axes, outcomes: pd.DataFrame, *, places: int) -> None:
    """Bars from the study's result, factors sorted by the largest change, in so many places."""
    is_study = outcomes["factor"].isna() | (outcomes["factor"] == "")
    study, varied = outcomes[is_study].iloc[0], outcomes[~is_study]
    if study["low"] == study["low"]:
        axes.axvspan(study["low"], study["high"], color=PALE, lw=0, zorder=0)
    axes.axvline(study["result"], color=GREY, lw=0.8, zorder=1)
    reach = varied["change"].abs().groupby(varied["factor"], sort=False).max()
    order = list(reach[reach > 0].sort_values(kind="stable", ascending=False).index)
    for place, factor in enumerate(order):
        values = varied[varied["factor"] == factor]
        height = 0.8 / len(values)
        for number, row in enumerate(values.itertuples(index=False)):
            at = place - 0.4 + (number + 0.5) * height
            colour = _COLOURS[number % len(_COLOURS)]
            axes.barh(at, row.change, height, left=study["result"], color=colour, zorder=2)
            leftwards = row.change < 0
            axes.annotate(
                row.value,
                (row.result, at),
                xytext=(-2 if leftwards else 2, 0),
                textcoords="offset points",
                ha="right" if leftwards else "left",
                va="center",
                fontsize=5,
                color=GREY,
            )
    axes.set_yticks(range(len(order)), order)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(places - 0.5, -0.5)
    axes.margins(x=0.3)
    axes.locator_params(axis="x", nbins=5)
