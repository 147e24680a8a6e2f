"""Was the prediction right? Maps of every patch, and its scores beside chance and the rivals."""

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from gstlib.figures.style import (
    AMBER,
    BLUE,
    CONTACT,
    GREY,
    LEGIBLE,
    PALE,
    VERMILION,
    block_of,
    draw_heights,
    draw_mask,
    new_figure,
    scale_bar,
    styled,
    thickened_note,
    write_notes,
)

__all__ = ["draw_agreement", "validation_figure"]

_HIT, _MISS, _FALSE_ALARM = BLUE, AMBER, CONTACT
_WIDTH = 11.0  # inches: for a screen, two patches side by side
# A map's side, the panels above and what is around them, in inches.
_MAP, _TOP, _AROUND = 1.08, 2.6, 0.95

_NAMES = {
    "precision": "precision",
    "recall": "recall",
    "f1": "F1",
    "iou": "IoU",
    "mcc": "MCC",
    "fss": "FSS",
    "roc_auc": "ROC-AUC",
    "pr_auc": "PR-AUC",
}
_RIVALS = {
    "highest": ("highest points", "^"),
    "rigid": ("rigid interpenetration", "s"),
    "curvature": ("convex points", "d"),
}
# One score of the masks that area alone does not raise, and one of the ranking.
_SHOWN = "mcc", "pr_auc"
_LEVEL = 0.05


@styled
def validation_figure(
    contacts: Mapping[str, xr.Dataset],
    registered: Mapping[str, xr.Dataset],
    scores: pd.DataFrame,
    gains: pd.DataFrame,
    failures: pd.DataFrame,
    summary: pd.DataFrame,
    *,
    pressures: Mapping[str, float] | None = None,
    source_note: str | None = None,
) -> Figure:
    """Predicted contact, measured loss and their agreement for each patch, with its scores.

    Above: the gain over the best rival, loss against pressure, and where loss was missed.

    Parameters
    ----------
    contacts : mapping of str to xarray.Dataset
        For each patch ``height`` (T0), ``pressure`` (y, x), ``mean_pressure`` (step).
    registered : mapping of str to xarray.Dataset
        For each patch ``change``, ``loss`` (y, x).
    scores, gains, failures, summary : pandas.DataFrame
        The tables ``validation_patches.csv``, ``validation_gains.csv``,
        ``validation_failures.csv``, ``validation_summary.csv``.
    pressures : mapping of str to float, optional
        Pressure (MPa) of every patch in the tables, where maps of some only are drawn. A patch
        that is not in the tables (it has no T1) is left out.
    """
    drawn = {patch: float(contacts[patch]["mean_pressure"][-1]) for patch in contacts}
    pressures = drawn if pressures is None else pressures
    order = sorted(drawn, key=drawn.get, reverse=True)
    across = min(2, max(1, len(order)))
    rows = max(1, math.ceil(len(order) / across))
    figure = new_figure(_WIDTH, _TOP + rows * _MAP + _AROUND)
    above, below = figure.subfigures(2, 1, height_ratios=[_TOP, rows * _MAP + 0.5])
    figure.suptitle(_verdict(gains, summary), fontsize=8.5, linespacing=1.4)

    best, by_pressure, by_height = above.subplots(1, 3, width_ratios=[1.1, 1, 1])
    _draw_gains(best, summary)
    _draw_extent(by_pressure, pressures, scores, summary)
    _draw_bands(by_height, failures)

    block = block_of(next(iter(contacts.values()))["height"].shape, _MAP) if contacts else 1
    grid = below.subplots(rows, 4 * across, squeeze=False, width_ratios=[1, 1, 1, 1.2] * across)
    for number, patch in enumerate(order):
        row, column = divmod(number, across)
        panels = grid[row, 4 * column : 4 * column + 4]
        contact, change = contacts[patch], registered[patch]
        _draw_maps(panels[:3], contact, change, block=block)
        panels[0].set_ylabel(f"patch {patch}\n{pressures[patch]:.3g} MPa", fontsize=7)
        _draw_scores(panels[3], patch, scores, gains)
        if row == 0:
            names = "predicted contact", "measured loss", "agreement", "score (p of chance)"
            for axes, name in zip(panels, names, strict=True):
                axes.set_title(name, fontsize=7.5)
        if number == 0:
            scale_bar(panels[0], 0.2)
        if number + across < len(order):
            panels[3].tick_params(labelbottom=False)
    for axes in grid.flat[4 * len(order) :]:
        axes.set_axis_off()
    below.legend(handles=_legend(), loc="outside lower center", ncols=8, fontsize=7)
    # few patches have no intervals
    has_intervals = summary["low"].notna().any()
    bootstrapped = "Bars and brackets: 95 % bootstrap over patches." if has_intervals else ""
    write_notes(
        figure,
        source_note,
        [
            bootstrapped,
            "Grey bar: 95 % of shifted copies.",
            "Grey: height; bare: change not known.",
            thickened_note(block),
        ],
    )
    return figure


def draw_agreement(axes: Axes, contact: xr.Dataset, registered: xr.Dataset, *, block: int) -> dict:
    """Mark hits, misses and false alarms of a patch; gives the three masks, by name and colour."""
    touching = contact["pressure"].values > 0
    loss = registered["loss"].values.astype(bool)
    inside = np.isfinite(registered["change"].values)
    classes = {
        "miss": (loss & ~touching, _MISS),
        "false alarm": (touching & ~loss & inside, _FALSE_ALARM),
        "hit": (loss & touching, _HIT),
    }
    for name, (mask, colour) in classes.items():
        draw_mask(axes, contact["height"], mask, colour, block=block, thicken=name != "miss")
    return classes


def _draw_maps(panels, contact: xr.Dataset, registered: xr.Dataset, *, block: int) -> None:
    """Predicted contact, measured loss, agreement."""
    t0 = contact["height"]
    unknown = np.isnan(registered["change"].values)
    predicted, lost, agreement = panels
    draw_heights(predicted, t0, relief=True, ticks=False)
    draw_mask(predicted, t0, contact["pressure"].values > 0, CONTACT, block=block, thicken=True)
    for axes in (lost, agreement):
        draw_heights(axes, t0, relief=True, ticks=False)
        draw_mask(axes, t0, unknown, "white", block=block)
    draw_mask(lost, t0, registered["loss"].values.astype(bool), VERMILION, block=block)
    draw_agreement(agreement, contact, registered, block=block)


def _draw_scores(axes: Axes, patch: str, scores: pd.DataFrame, gains: pd.DataFrame) -> None:
    """The patch's scores on one axis: chance, rivals, contact."""
    of_patch = scores[scores["patch"] == patch].iloc[0]
    for place, score in enumerate(_SHOWN):
        found = gains[(gains["patch"] == patch) & (gains["score"] == score)].iloc[0]
        axes.hlines(place, found["null_low"], found["null_high"], color=PALE, lw=8)
        axes.plot(found["value"], place, "o", color=BLUE, markersize=5)
        for name, (_, marker) in _RIVALS.items():
            if f"{name}_{score}" in scores:
                value = of_patch[f"{name}_{score}"]
                axes.plot(value, place, marker, mfc="none", mec=CONTACT, mew=0.7, markersize=5)
        if math.isfinite(found["p_value"]):
            axes.annotate(
                _p_text(found["p_value"]),
                (1.0, place),
                xycoords=("axes fraction", "data"),
                xytext=(-1, 7),
                textcoords="offset points",
                ha="right",
                fontsize=6,
                color=GREY,
            )
    axes.set_yticks(range(len(_SHOWN)), [_NAMES[score] for score in _SHOWN], fontsize=6.5)
    axes.set_xlim(-0.15, 1)
    axes.set_ylim(len(_SHOWN) - 0.4, -0.75)
    axes.axvline(0, color=GREY, lw=0.5, ls=":", zorder=0)
    axes.set_xticks([0, 0.5, 1])
    axes.tick_params(axis="x", labelsize=6)


def _draw_gains(axes: Axes, summary: pd.DataFrame) -> None:
    """Mean gain of each score over its best rival."""
    axes.axvline(0, color=GREY, lw=0.8)
    for place, score in enumerate(_NAMES):
        row = summary[summary["statistic"] == f"gain({score})"]
        if not len(row) or not math.isfinite(row["value"].iloc[0]):
            continue
        found = row.iloc[0]
        colour = {1: BLUE, -1: VERMILION, 0: GREY}[_sign(found)]
        axes.plot([found["low"], found["high"]], [place, place], color=colour)
        axes.plot(found["value"], place, "o", color=colour, markersize=4.5)
        axes.annotate(
            f"vs {_RIVALS[found['against']][0]}",
            (1.0, place),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="center",
            fontsize=6.5,
            color=GREY,
        )
    axes.set_yticks(range(len(_NAMES)), list(_NAMES.values()))
    axes.set_ylim(len(_NAMES) - 0.4, -0.6)
    low, high = axes.get_xlim()
    reach = max(0.02, -low, high)
    # room at the right for the rivals' names
    axes.set_xlim(-1.1 * reach, 2.2 * reach)
    axes.set_xlabel("gain: score less that of the best rival")
    axes.set_title("Is contact better than its best rival?", fontsize=8)


def _draw_extent(
    axes: Axes, pressures: Mapping[str, float], scores: pd.DataFrame, summary: pd.DataFrame
) -> None:
    """Area with loss of each patch against its pressure."""
    lost = scores.set_index("patch")["loss_fraction"].dropna()
    lost = lost[lost.index.isin(list(pressures))]
    for patch, share in lost.items():
        axes.plot(pressures[patch], 100 * share, "o", color=VERMILION)
        if len(lost) <= LEGIBLE:
            axes.annotate(
                patch,
                (pressures[patch], 100 * share),
                xytext=(3, 3),
                textcoords="offset points",
                fontsize=6.5,
            )
    axes.set(xlabel="patch pressure (MPa)", ylabel="area with loss (%)")
    axes.margins(0.13)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    row = _row(summary, "spearman(pressure_MPa, loss_fraction)")
    if row is not None:
        told = f"Spearman ρ = {_interval(row)}"
        if math.isfinite(row["p_value"]):
            told += f"\n{_p_text(row['p_value'])}"
        axes.annotate(told, (0.02, 0.98), xycoords="axes fraction", va="top", fontsize=6.5)
    axes.set_title("Are harder pressed patches more worn?", fontsize=8)


def _draw_bands(axes: Axes, failures: pd.DataFrame) -> None:
    """Where the loss lies by height, and how much of it was predicted: means over the patches."""
    bands = failures[failures["split"] == "height"].groupby("band", sort=False)
    means = 100 * bands[["area_share", "loss_share", "hit_share"]].mean()
    places = np.arange(len(means))
    axes.barh(places, means["loss_share"], color=_MISS)
    axes.barh(places, means["hit_share"], color=_HIT)
    for place, (_, found) in zip(places, means.iterrows(), strict=True):
        missed = found["loss_share"] - found["hit_share"]
        if math.isfinite(missed):
            axes.annotate(
                f"{missed:.0f} % missed",
                (found["loss_share"], place),
                xytext=(2, 0),
                textcoords="offset points",
                va="center",
                fontsize=6.5,
            )
    axes.set_yticks(places, means.index)
    axes.set_ylim(-0.6, len(means) - 0.4)
    axes.margins(x=0.25)
    axes.set(xlabel="share of all loss (%)", ylabel="height band (0: lowest)")
    axes.set_title("At what height is the loss, and was it predicted?", fontsize=8)


def _legend() -> list:
    rivals = [
        Line2D([], [], marker=marker, ls="none", mfc="none", mec=CONTACT, mew=0.7, label=label)
        for label, marker in _RIVALS.values()
    ]
    return [
        Patch(color=_HIT, label="hit"),
        Patch(color=_MISS, label="miss"),
        Patch(color=_FALSE_ALARM, label="false alarm"),
        Line2D([], [], marker="o", ls="none", color=BLUE, label="predicted contact"),
        *rivals,
        Patch(color=PALE, label="chance: shifted copies"),
    ]


def _verdict(gains: pd.DataFrame, summary: pd.DataFrame) -> str:
    """What the tables say, in two sentences."""
    score = _SHOWN[-1]
    tested = gains[(gains["score"] == score)].dropna(subset=["p_value"])
    better = int((tested["p_value"] <= _LEVEL).sum())
    lines = [
        f"Chance: in {better} of {len(tested)} patches, contact ranks the loss better than "
        f"shifted copies of itself do ({_NAMES[score]}, p ≤ {_LEVEL})."
    ]
    parts = []
    for score in _SHOWN:
        row = _row(summary, f"gain({score})")
        if row is not None:
            parts.append(
                f"{_judged(row)} {_RIVALS[row['against']][0]} ({_NAMES[score]} {_interval(row)})"
            )
    if parts:
        lines.append("Best rival: contact " + "; ".join(parts) + ".")
    return "\n".join(lines)


def _judged(row: pd.Series) -> str:
    return {1: "does better than", -1: "does worse than", 0: "is not told apart from"}[_sign(row)]


def _sign(row: pd.Series) -> int:
    """Sign of a gain that both its interval and its test tell from 0; else 0."""
    if not row["p_value"] <= _LEVEL:
        return 0
    return int(row["low"] > 0) - int(row["high"] < 0)


def _row(summary: pd.DataFrame, statistic: str) -> pd.Series | None:
    rows = summary[summary["statistic"] == statistic]
    return rows.iloc[0] if len(rows) and math.isfinite(rows["value"].iloc[0]) else None


def _interval(row: pd.Series) -> str:
    value, low, high = (f"{row[name]:.2g}".replace("-", "−") for name in ("value", "low", "high"))
    return value if math.isnan(row["low"]) else f"{value} [{low}, {high}]"


def _p_text(p: float) -> str:
    if p < 0.001:
        return "p < 0.001"
    return f"p = {p:.1g}" if p < 0.1 else f"p = {p:.2f}"
