"""Figures drawn from tables alone: the verdict, wear, texture."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gst.page.figures import style
from gst.page.figures.style import AMBER, BLACK, BLUE, GREEN, GREY, VERMILION, styled
from gst.page.verdict import MODELS, TOUCHED
from gstlib.validation.baselines import ORACLE
from gstlib.validation.summary import statistic_names
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

__all__ = ["texture_figure", "validation_figure", "wear_figure"]

# Parameters that single points do not dominate: roughness, core, summits, dales, grain, direction.
_TEXTURE = {
    "Sq_um": "r.m.s. height",
    "Sk_um": "height of the core",
    "Spk_um": "height of the summits",
    "Svk_um": "depth of the dales",
    "Sal_um": "grain",
    "Str": "isotropy (1: in no direction)",
}
_CORRELATED = {
    "pressure and worn area": "spearman(pressure_MPa, loss_fraction)",
    "touched or not and loss": TOUCHED,
}
# Of the predictions; baselines are grey, and the cap is open.
_LOOKS = {BARE: (BLUE, "o"), INTERLAYER: (GREEN, "D"), CAPPED: (AMBER, "s")}


@styled
def validation_figure(
    patches: pd.DataFrame, losses: pd.DataFrame, summary: pd.DataFrame
) -> Figure:
    """Mean agreement of the prediction and its baselines with the loss, and loss against pressure.

    `patches` and `summary` are ``validation_patches.csv`` and ``validation_summary.csv``; `losses`
    is ``registration.csv`` with ``stated_MPa``, from `gstlib.coupling.pressures.stated`.
    """
    figure, (agreement, extent) = style.panels(2, 2, 1.0)
    _draw_agreement(agreement, summary)
    losses = losses[losses.above_noise.astype(bool)].dropna(subset="mean_wear_depth_um")
    in_statistics = patches.patch[patches.in_statistics.astype(bool)]
    _draw_losses(extent, losses, losses.patch.isin(in_statistics))
    extent.set_title("\n".join(_correlations(summary)), fontsize=6.5)
    return figure


def _draw_losses(axes: Axes, losses: pd.DataFrame, is_counted: pd.Series) -> None:
    """The loss of each patch over its pressure; those that are counted in colour."""
    is_touched = losses.stated_MPa > 0
    for name, those, colour, fill in (
        ("in the study", is_touched & is_counted, VERMILION, VERMILION),
        ("touched, left out", is_touched & ~is_counted, GREY, GREY),
        ("not touched", ~is_touched, GREY, "white"),
    ):
        drawn = losses[those]
        look = {"color": colour, "mfc": fill, "clip_on": False, "zorder": 3}
        look["in_layout"] = False  # an empty one would lie at the corner of the figure
        axes.plot(drawn.stated_MPa, drawn.mean_wear_depth_um, "o", label=name, **look)
    axes.set(
        xlabel="pressure under the given load (MPa)", ylabel="mean depth lost (µm)"
    )
    axes.set(xlim=(0, None), ylim=(0, None))
    touched = losses[is_touched]
    ends = touched[["stated_MPa", "mean_wear_depth_um"]].to_numpy()
    style.write_all(axes, list(touched.patch), ends)
    axes.legend(loc="upper left")


def _correlations(summary: pd.DataFrame) -> Iterator[str]:
    """A question, and the correlations that answer it."""
    yield "Do patches under higher pressure wear more?"
    names = statistic_names(summary)
    for words, name in _CORRELATED.items():
        for row in summary[names == name].dropna(subset="value").itertuples():
            interval = (
                f" [{row.low:.2g}, {row.high:.2g}]" if math.isfinite(row.low) else ""
            )
            tested = (
                f"p = {row.p_value:.2g}" if math.isfinite(row.p_value) else "not tested"
            )
            yield f"{words}: ρ = {row.value:.2g}{interval}, {tested}".replace("-", "−")


def _draw_agreement(axes: Axes, summary: pd.DataFrame) -> None:
    """The mean MCC of each model with its interval, one below the other."""
    means, attainable = (
        summary[(summary.statistic == "mean") & (summary.x == score)].set_index("model")
        for score in ("mcc", "attainable_mcc")
    )
    for place, row in enumerate(means.itertuples()):
        model = row.Index
        colour, marker = _LOOKS.get(model, (GREY, "o"))
        fill = "white" if model == ORACLE else colour
        if math.isfinite(row.low):
            axes.plot([row.low, row.high], [place, place], color=colour)
        axes.plot(row.value, place, marker, color=colour, mfc=fill)
        if model in attainable.index:
            axes.plot(attainable.value[model], place, "|", color=colour, ms=9)
        style.write_beside(
            axes, MODELS[model], (0, place - 0.42), color=colour, in_layout=False
        )
    axes.set(xlim=(0, 1), ylim=(len(means) - 0.5, -0.7), yticks=[])
    axes.set_xlabel("mean MCC of predicted and measured loss")
    count = int(means.n.max()) if len(means) else 0
    title = f"Was the position of the loss predicted? ({count} patches)"
    axes.set_title(
        f"{title}\n| the most that masks of its areas could reach", fontsize=7
    )


@styled
def texture_figure(table: pd.DataFrame) -> Figure:
    """Six texture parameters of every patch at T0 and T1; `table` is ``texture.csv``."""
    before, after = (
        table[table["epoch"] == epoch].set_index("patch") for epoch in ("T0", "T1")
    )
    after, places = after.reindex(before.index), np.arange(len(before))
    figure, axes = style.panels(len(_TEXTURE), 2, 0.6)
    for panel, (column, title) in zip(axes, _TEXTURE.items(), strict=True):
        panel.set_title(title)
        old, new = before[column], after[column]
        panel.vlines(places, old, new, color=VERMILION)
        panel.plot(places, new, "o", color=VERMILION, label="T1")
        panel.plot(places, old, "o", mfc="white", color=GREY, label="T0")
        style.name_patches(panel, list(before.index))
        panel.set_ylabel(column.replace("_um", " (µm)"))
    axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return figure


@styled
def wear_figure(
    table: pd.DataFrame,
    profile: pd.DataFrame,
    limits: pd.DataFrame,
    in_statistics: Iterable[str],
) -> Figure:
    """Predicted against measured volume of every patch, and loss by height.

    `table` and `profile` are ``wear.csv`` and ``wear_profile.csv``, of which only the patches
    `in_statistics` are drawn; `limits` is ``patch_intervals.csv``: a volume and its interval are
    proportional to the pressure.
    """
    figure, (volumes, heights) = style.panels(2, 2, 1.05)
    counted = list(in_statistics)
    _draw_volumes(volumes, table[table.patch.isin(counted)], limits.set_index("patch"))
    figure.legend(
        *volumes.get_legend_handles_labels(), loc="outside upper center", ncols=3
    )
    _draw_heights(heights, profile[profile.patch.isin(counted)])
    return figure


def _draw_volumes(axes: Axes, table: pd.DataFrame, limits: pd.DataFrame) -> None:
    """The predicted volume of each patch over the measured one, 10⁵ µm³."""
    names: list[str] = []
    for model, (colour, marker) in _LOOKS.items():
        rows = table[table.model == model]
        if rows.empty:
            continue
        measured = rows.measured_volume_um3.to_numpy() / 1e5
        predicted = rows.predicted_volume_um3.to_numpy() / 1e5
        look = (
            {"mfc": "none"} if model == CAPPED else {}
        )  # it may lie over the elastic one
        axes.plot(
            measured, predicted, marker, color=colour, label=MODELS[model], **look
        )
        if model == BARE:
            names, ends = list(rows.patch), list(zip(measured, predicted, strict=True))
            own = limits.loc[rows.patch]
            low, high = (
                own[["low_MPa", "high_MPa"]].div(own.pressure_MPa, axis=0).to_numpy().T
            )
            axes.vlines(
                measured, predicted * low, predicted * high, color=colour, lw=0.8
            )
    most = 1.05 * max(1e-9, axes.dataLim.x1, axes.dataLim.y1)
    axes.plot([0, most], [0, most], color=GREY, lw=0.6)
    axes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    if names:
        style.write_all(axes, names, ends, color=[BLUE] * len(names))
    axes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    axes.set_title("How much did each patch lose?")


def _draw_heights(axes: Axes, profile: pd.DataFrame) -> None:
    """The mean loss at each quarter of the heights."""
    means = profile.groupby(["model", "band"], sort=False).loss_um.mean()
    for model, (colour, marker) in ({"measured": (BLACK, "x")} | _LOOKS).items():
        if model in means:
            look = {"mfc": "none", "ls": "--"} if model == CAPPED else {}
            axes.plot(
                means[model], means[model].index, color=colour, marker=marker, **look
            )
    style.write_beside(
        axes, "× measured", (means["measured"][3], 3), (8, 0), fontsize=8
    )
    bands = ["highest\nquarter", "second", "third", "lowest\nquarter"]
    axes.set_yticks(range(1, len(bands) + 1), bands)
    axes.invert_yaxis()
    axes.set_xlim(left=0)
    axes.set_xlabel("mean loss (µm)")
    axes.set_title("At which heights?")
