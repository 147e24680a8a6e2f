"""Figures drawn from tables alone: the verdict, wear, texture."""

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gst.page.figures import style
from gst.page.figures.style import AMBER, BLACK, BLUE, GREEN, GREY, VERMILION
from gst.page.results import Results
from gst.page.verdict import MODELS, TOUCHED
from gstlib.validation.baselines import ORACLE
from gstlib.validation.summary import statistic_names
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

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
# Of the measured loss and the predictions; baselines are grey. The cap, which may lie over the
# elastic prediction, is open, and so is the baseline that receives more data.
_BASELINE: dict[str, Any] = {"color": GREY, "marker": "o"}
_LOOKS: dict[Any, dict[str, Any]] = {
    "measured": {"color": BLACK, "marker": "x"},
    BARE: {"color": BLUE, "marker": "o"},
    INTERLAYER: {"color": GREEN, "marker": "D"},
    CAPPED: {"color": AMBER, "marker": "s", "mfc": "none", "ls": "--"},
    ORACLE: _BASELINE | {"mfc": "none"},
}


def validation_figure(study: Results) -> Figure:
    """Mean agreement of prediction and baselines with the loss, and loss against pressure."""
    figure, (agreement, extent) = style.panels(2, 2, 1.0)
    summary = study.table("validation_summary")
    _draw_agreement(agreement, summary)
    patches = study.table("validation_patches")
    losses = study.losses.dropna(subset="mean_wear_depth_um")
    counted = patches.patch[patches.in_statistics]
    _draw_losses(extent, losses[losses.above_noise.astype(bool)], counted)
    lines = ["Do patches under higher pressure wear more?"]
    names = statistic_names(summary)
    for words, name in _CORRELATED.items():
        for row in summary[names == name].dropna(subset="value").itertuples():
            interval = f"[{row.low:.2g}, {row.high:.2g}], p = {row.p_value:.2g}"
            lines.append(f"{words}: ρ = {row.value:.2g} {interval}")
    title = "\n".join(lines).replace(" [nan, nan]", "").replace("p = nan", "not tested")
    extent.set_title(title.replace("-", "−"), fontsize=6.5)
    return figure


def _draw_losses(axes: Axes, losses: pd.DataFrame, counted: pd.Series) -> None:
    """The loss of each patch over its pressure; those that are counted in colour."""
    is_touched, is_counted = losses.stated_MPa > 0, losses.patch.isin(counted)
    looks = {
        "in the study": (is_touched & is_counted, VERMILION, VERMILION),
        "touched, left out": (is_touched & ~is_counted, GREY, GREY),
        "not touched": (~is_touched, GREY, "white"),
    }
    for name, (those, colour, fill) in looks.items():
        axes.plot(
            losses.stated_MPa[those],
            losses.mean_wear_depth_um[those],
            "o",
            color=colour,
            mfc=fill,
            clip_on=False,
            zorder=3,
            in_layout=False,  # an empty one would lie at the corner of the figure
            label=name,
        )
    axes.set(xlim=(0, None), xlabel="pressure under the given load (MPa)")
    axes.set(ylim=(0, None), ylabel="mean depth lost (µm)")
    touched = losses[is_touched]
    ends = touched[["stated_MPa", "mean_wear_depth_um"]].to_numpy()
    style.write_all(axes, list(touched.patch), ends, [BLACK] * len(ends))
    axes.legend(loc="upper left")


def _draw_agreement(axes: Axes, summary: pd.DataFrame) -> None:
    """The mean MCC of each model with its interval, one below the other."""
    means = summary[summary.statistic == "mean"].set_index("model")
    attainable = means[means.x == "attainable_mcc"].value
    means = means[means.x == "mcc"]
    for place, (model, row) in enumerate(means.iterrows()):
        look = _LOOKS.get(model, _BASELINE)
        colour = look["color"]
        axes.plot([row.low, row.high], [place, place], color=colour)
        axes.plot(row.value, place, **look)
        axes.plot(attainable.get(model, math.nan), place, "|", color=colour, ms=9)
        at = 0, place - 0.42
        name = style.write_beside(axes, MODELS[model], at, (2, 0), color=colour)
        name.set_in_layout(False)
    axes.set(xlim=(0, 1), ylim=(len(means) - 0.5, -0.7), yticks=[])
    axes.set_xlabel("mean MCC of predicted and measured loss")
    count = int(means.n.max()) if len(means) else 0
    axes.set_title(
        f"Was the position of the loss predicted? ({count} patches)\n"
        "| the most that masks of its areas could reach",
        fontsize=7,
    )


def texture_figure(study: Results) -> Figure:
    """Six texture parameters of every patch at T0 and T1."""
    table = study.table("texture").set_index("patch")
    before, after = (table[table.epoch == epoch] for epoch in ("T0", "T1"))
    after, places = after.reindex(before.index), np.arange(len(before))
    figure, axes = style.panels(len(_TEXTURE), 2, 0.6)
    for panel, (column, title) in zip(axes, _TEXTURE.items(), strict=True):
        old, new = before[column], after[column]
        panel.vlines(places, old, new, color=VERMILION)
        panel.plot(places, new, "o", color=VERMILION, label="T1")
        panel.plot(places, old, "o", mfc="white", color=GREY, label="T0")
        style.name_patches(panel, list(before.index))
        panel.set(title=title, ylabel=column.replace("_um", " (µm)"))
    axes[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return figure


def wear_figure(study: Results) -> Figure:
    """Predicted against measured volume of every patch in the statistics, and loss by height."""
    figure, (volumes, heights) = style.panels(2, 2, 1.05)
    patches = study.table("validation_patches")
    counted = patches.patch[patches.in_statistics]
    wear, profile = (
        table[table.patch.isin(counted)]
        for table in map(study.table, ("wear", "wear_profile"))
    )
    _draw_volumes(volumes, wear, study.table("patch_intervals"))
    for model, rows in profile.groupby("model", sort=False):
        means = rows.groupby("band").loss_um.mean()
        name = MODELS.get(model, model)
        heights.plot(means, means.index, label=name, **_LOOKS[model])
    bands = ["highest\nquarter", "second", "third", "lowest\nquarter"]
    heights.set_yticks(range(1, len(bands) + 1), bands)
    heights.invert_yaxis()
    heights.set(xlim=(0, None), xlabel="mean loss (µm)", title="At which heights?")
    handles = heights.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4)
    return figure


def _draw_volumes(axes: Axes, wear: pd.DataFrame, intervals: pd.DataFrame) -> None:
    """The predicted volume of each patch over the measured one, 10⁵ µm³.

    The interval of a volume is in proportion to that of the pressure.
    """
    volumes = wear[["measured_volume_um3", "predicted_volume_um3"]] / 1e5
    volumes = volumes.set_axis(wear.patch)
    for model in (BARE, INTERLAYER, CAPPED):
        points = volumes[(wear.model == model).values].to_numpy()
        axes.plot(*points.T, **_LOOKS[model] | {"ls": "none"})
    bare = volumes[(wear.model == BARE).values]
    own = intervals.set_index("patch").loc[bare.index]
    low, high = (
        bare.predicted_volume_um3 * end / own.pressure_MPa
        for end in (own.low_MPa, own.high_MPa)
    )
    axes.vlines(bare.measured_volume_um3, low, high, color=BLUE, lw=0.8)
    most = 1.05 * max(1e-9, axes.dataLim.x1, axes.dataLim.y1)
    axes.plot([0, most], [0, most], color=GREY, lw=0.6)
    axes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    style.write_all(axes, list(bare.index), bare.to_numpy(), [BLUE] * len(bare))
    axes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    axes.set_title("How much did each patch lose?")
