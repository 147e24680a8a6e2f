"""Figures drawn from tables alone: validation, wear, texture, sweep."""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from gst.figures import style
from gst.figures.style import AMBER, BLACK, BLUE, CHARTS, GREEN, GREY, PALE, VERMILION, styled
from gst.verdict import LEVEL, SCORE, against_chance, against_rival

__all__ = ["sweep_figure", "texture_figure", "validation_figure", "wear_figure"]

# Parameters that single points do not dominate: roughness, core, summits, dales, grain, direction.
_TEXTURE = {
    "Sq_um": "r.m.s. height",
    "Sk_um": "height of the core",
    "Spk_um": "height of the summits",
    "Svk_um": "depth of the dales",
    "Sal_um": "grain",
    "Str": "isotropy (1: in no direction)",
}
_PAIR = "spearman(pressure_MPa, loss_fraction)"
_OUTCOMES = ["relative_change(pressure_MPa)", _PAIR, "mean(f1)", "gain(f1)", "gain(roc_auc)"]
_OUTCOMES += ["mean_change(Sq_um)"]
_MODELS = {
    "archard": ("Archard's law", BLUE, "o"),
    "mat": ("Archard's law with a mat", GREEN, "D"),
    "pressure": ("in proportion to pressure", AMBER, "s"),
    "uniform": ("the same on every patch", GREY, "v"),
    "truncation": ("cut off flat over the worn area", VERMILION, "^"),
}


@styled
def validation_figure(
    scores: pd.DataFrame, gains: pd.DataFrame, summary: pd.DataFrame, variants: pd.DataFrame
) -> Figure:
    """Gains over the best rivals, and loss against pressure.

    `scores` is ``validation_patches.csv`` with the columns ``pressure_MPa`` and ``loss_fraction``;
    the others are ``validation_gains.csv`` and so on.
    """
    figure, (gain, extent) = style.panels(
        2, 2, (3.2, 2.2), (0.75, 0.1, 0.35, 0.45), head=0.3 + 0.15 * variants.variant.nunique()
    )
    headlines = [
        f"{row.variant}: {against_rival(row)}"
        for row in variants[variants["score"] == SCORE].itertuples()
    ]
    figure.suptitle("\n".join([*headlines, against_chance(gains)]), fontsize=7)
    # the mean gain of each score over its best rival, in colour where it differs from 0
    of_own = variants[variants["variant"] == variants["variant"].iloc[0]]
    means = of_own.dropna(subset="gain")
    gain.axvline(0, color=GREY, lw=0.8)
    for place, row in enumerate(means.itertuples()):
        # both the interval and the test must distinguish the gain from 0
        sign = (int(row.low > 0) - int(row.high < 0)) * int(row.p_value <= LEVEL)
        colour = {1: BLUE, -1: VERMILION, 0: GREY}[sign]
        gain.plot([row.low, row.high], [place, place], color=colour)
        gain.plot(row.gain, place, "o", color=colour)
    names = means["score"].str.replace("_", "-") + "\nvs " + means["best_rival"]
    gain.set_yticks(range(len(means)), names, fontsize=6)
    gain.invert_yaxis()
    gain.set_xlabel("gain: score of contact − score of the best rival")
    gain.set_title("Is contact better than its best rival?")

    known = scores[scores["believed"].astype(bool)].dropna(subset="loss_fraction")
    lost = 100 * known["loss_fraction"]
    extent.plot(known["pressure_MPa"], lost, "o", color=VERMILION)
    for at in zip(known["patch"], known["pressure_MPa"], lost, strict=True):
        style.write_beside(extent, at[0], at[1:], (3, 5))
    title = "Do patches under more pressure wear more?"
    for row in summary[summary["statistic"] == _PAIR].dropna(subset="value").itertuples():
        interval = f" [{row.low:.2g}, {row.high:.2g}]" if math.isfinite(row.low) else ""
        tested = f", p = {row.p_value:.2g}" if math.isfinite(row.p_value) else ", not tested"
        title += f"\nSpearman ρ = {row.value:.2g}{interval}{tested}".replace("-", "−")
    extent.set(xlabel="pressure of the patch (MPa)", ylabel="area with loss (%)", title=title)
    extent.set(xlim=(0, None), ylim=(0, None))
    return figure


@styled
def texture_figure(table: pd.DataFrame) -> Figure:
    """Six texture parameters of every patch at T0 and T1; `table` is ``texture.csv``."""
    before, after = (
        table[table["epoch"] == epoch].set_index("patch") for epoch in ("T0", "T1")
    )
    after, places = after.reindex(before.index), np.arange(len(before))
    figure, axes = style.panels(len(_TEXTURE), 2, (3.0, 1.4), CHARTS, head=0.1)
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
def sweep_figure(table: pd.DataFrame) -> Figure:
    """Tornado diagrams of the outcomes of a sweep; `table` is ``sweep.csv``."""
    is_study = table["factor"].isna() | (table["factor"] == "")
    study = table[is_study].set_index("output")
    varied = table[~is_study & table["change"].abs().gt(0)]
    outcomes = [output for output in _OUTCOMES if output in study.index]
    moved = varied.assign(setting=varied["factor"] + ": " + varied["value"].astype(str))
    moved = moved[moved["output"].isin(outcomes)]
    bars = max([1, *moved["output"].value_counts()])
    left = 0.3 + 0.05 * max([0, *moved["setting"].str.len()])
    figure, axes = style.panels(len(outcomes), 2, (2.1, 0.13 * bars), (left, 0.1, 0.35, 0.4))
    for panel, output in zip(axes, outcomes, strict=True):
        result = study.loc[output]
        if np.isfinite(result["low"]):
            panel.axvspan(result["low"], result["high"], color=PALE, lw=0)
        panel.axvline(result["result"], color=GREY, lw=0.8)
        of = moved[moved["output"] == output].sort_values("change", key=abs, kind="stable")
        panel.barh(of["setting"], of["change"], left=result["result"], color=BLUE)
        panel.tick_params(axis="y", labelsize=5.5)
        panel.locator_params(axis="x", nbins=5)
        panel.set_title(output.replace("_um", " (µm)"))
    return figure


@styled
def wear_figure(table: pd.DataFrame, profile: pd.DataFrame, limits: pd.DataFrame) -> Figure:
    """Predicted against measured volume of every patch, and loss by height.

    `table` is ``wear.csv``, `profile` is ``wear_profile.csv``; `limits` is ``patch_intervals.csv``:
    a volume and its interval are proportional to the pressure.
    """
    figure, (volumes, heights) = style.panels(2, 2, (2.6, 2.6), (0.7, *CHARTS[1:]), head=0.4)
    units = 1e5  # µm³
    models = {model: of for model, of in _MODELS.items() if model in set(table.model)}
    for model, (name, colour, marker) in models.items():
        of = table[table.model == model]
        places = of.measured_volume_um3 / units, of.predicted_volume_um3 / units
        volumes.plot(*places, color=colour, marker=marker, ls="", label=name)
        if model == "archard":
            share = limits.set_index("patch").loc[of.patch]
            low, high = (share[end] / share.pressure_MPa for end in ("low_MPa", "high_MPa"))
            ends = places[1].to_numpy() * np.array([low, high])
            volumes.vlines(places[0], *ends, color=colour, lw=0.8)
            for patch, x, y in zip(of.patch, *places, strict=True):
                style.write_beside(volumes, patch, (x, y), (3, 3), color=colour)
    most = table[["measured_volume_um3", "predicted_volume_um3"]].to_numpy().max() / units
    most = 1.05 * max(most, volumes.dataLim.y1)
    volumes.plot([0, most], [0, most], color=GREY, lw=0.6)
    volumes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    volumes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    volumes.set_title("How much did each patch lose?")
    figure.legend(*volumes.get_legend_handles_labels(), loc="upper center", ncols=3)

    means = (
        profile[profile.by == "height"].groupby(["model", "band"], sort=False).loss_um.mean()
    )
    for model, (_, colour, marker) in ({"measured": ("", BLACK, "x")} | models).items():
        if model in means:
            heights.plot(means[model], means[model].index, color=colour, marker=marker)
    heights.annotate(
        "× measured", (means["measured"][3], 3), (8, -3), textcoords="offset points"
    )
    bands = ["highest\nquarter", "second", "third", "lowest\nquarter"]
    heights.set_yticks(range(1, len(bands) + 1), bands)
    heights.invert_yaxis()
    heights.set_xlim(left=0)
    heights.set_xlabel("mean loss (µm)")
    heights.set_title("At which heights?")
    return figure
