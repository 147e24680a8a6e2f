"""Figures drawn from tables alone: the verdict, wear, texture."""

import math
from collections.abc import Iterable

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
    in_statistics = set(patches.patch[patches.in_statistics.astype(bool)])
    known = losses[losses.above_noise.astype(bool)].dropna(subset="mean_wear_depth_um")
    is_touched, is_in_statistics = known.stated_MPa > 0, known.patch.isin(in_statistics)
    for name, those, colour, fill in (
        ("in the study", is_touched & is_in_statistics, VERMILION, VERMILION),
        ("touched, left out", is_touched & ~is_in_statistics, GREY, GREY),
        ("not touched", ~is_touched, GREY, "white"),
    ):
        at = known.stated_MPa[those], known.mean_wear_depth_um[those]
        look = {"color": colour, "mfc": fill, "label": name, "clip_on": False, "zorder": 3}
        look["in_layout"] = False  # an empty one would lie at the corner of the figure
        extent.plot(*at, "o", **look)
    extent.set(xlabel="pressure under the load as stated (MPa)", ylabel="loss per area (µm)")
    extent.set(xlim=(0, None), ylim=(0, None))
    touched = known[is_touched]
    ends = list(zip(touched.stated_MPa, touched.mean_wear_depth_um, strict=True))
    style.write_all(extent, list(touched.patch), ends)
    title = "Do patches under more pressure wear more?"
    pairs = {
        "pressure and worn area": "spearman(pressure_MPa, loss_fraction)",
        "touched or not and loss": TOUCHED,
    }
    names = statistic_names(summary)
    for words, name in pairs.items():
        for row in summary[names == name].dropna(subset="value").itertuples():
            interval = f" [{row.low:.2g}, {row.high:.2g}]" if math.isfinite(row.low) else ""
            tested = f"p = {row.p_value:.2g}" if math.isfinite(row.p_value) else "not tested"
            title += f"\n{words}: ρ = {row.value:.2g}{interval}, {tested}".replace("-", "−")
    extent.set_title(title, fontsize=6.5)
    extent.legend(loc="upper left")
    return figure


def _draw_agreement(axes: Axes, summary: pd.DataFrame) -> None:
    """The mean MCC of each model with its interval, one below the other."""
    means, attainable = (
        summary[(summary.statistic == "mean") & (summary.x == score)].set_index("model")
        for score in ("mcc", "attainable_mcc")
    )
    for place, row in enumerate(means.itertuples()):
        colour, marker = _LOOKS.get(row.Index, (GREY, "o"))
        fill = "white" if row.Index == ORACLE else colour
        if math.isfinite(row.low):
            axes.plot([row.low, row.high], [place, place], color=colour)
        axes.plot(row.value, place, marker, color=colour, mfc=fill)
        if row.Index in attainable.index:
            axes.plot(attainable.value[row.Index], place, "|", color=colour, ms=9)
        at = 0, place - 0.42
        style.write_beside(axes, MODELS[row.Index], at, color=colour, in_layout=False)
    axes.set(xlim=(0, 1), ylim=(len(means) - 0.5, -0.7), yticks=[])
    axes.set_xlabel("mean MCC of predicted and measured loss")
    count = int(means.n.max()) if len(means) else 0
    title = f"Was the place of the loss predicted? ({count} patches)"
    axes.set_title(f"{title}\n| the most that masks of its areas could reach", fontsize=7)


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
    table, profile = (of[of.patch.isin(list(in_statistics))] for of in (table, profile))
    units = 1e5  # µm³
    models = [model for model in _LOOKS if model in set(table.model)]
    named: tuple[list[str], list] = [], []
    for model in models:
        of, (colour, marker) = table[table.model == model], _LOOKS[model]
        places = of.measured_volume_um3 / units, of.predicted_volume_um3 / units
        look = {"mfc": "none"} if model == CAPPED else {}  # it may lie over the elastic one
        volumes.plot(*places, marker, color=colour, label=MODELS[model], **look)
        if model == BARE:
            share = limits.set_index("patch").loc[of.patch]
            low, high = (share[end] / share.pressure_MPa for end in ("low_MPa", "high_MPa"))
            ends = places[1].to_numpy() * np.array([low, high])
            volumes.vlines(places[0], *ends, color=colour, lw=0.8)
            named = list(of.patch), list(zip(*places, strict=True))
    most = 1.05 * max(1e-9, volumes.dataLim.x1, volumes.dataLim.y1)
    volumes.plot([0, most], [0, most], color=GREY, lw=0.6)
    volumes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    style.write_all(volumes, *named, color=[BLUE] * len(named[0]))
    volumes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    volumes.set_title("How much did each patch lose?")
    figure.legend(*volumes.get_legend_handles_labels(), loc="outside upper center", ncols=3)

    means = profile.groupby(["model", "band"], sort=False).loss_um.mean()
    for model, (colour, marker) in ({"measured": (BLACK, "x")} | _LOOKS).items():
        if model in means:
            look = {"mfc": "none", "ls": "--"} if model == CAPPED else {}
            heights.plot(means[model], means[model].index, color=colour, marker=marker, **look)
    style.write_beside(heights, "× measured", (means["measured"][3], 3), (8, 0), fontsize=8)
    bands = ["highest\nquarter", "second", "third", "lowest\nquarter"]
    heights.set_yticks(range(1, len(bands) + 1), bands)
    heights.invert_yaxis()
    heights.set_xlim(left=0)
    heights.set_xlabel("mean loss (µm)")
    heights.set_title("At which heights?")
    return figure
