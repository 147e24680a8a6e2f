"""Prediction beside what use did (the paper's Fig. 11), and results beside what is known."""

import math

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gstlib.figures.macroscale import draw_footprints, draw_forces
from gstlib.figures.scores import draw_agreement
from gstlib.figures.style import (
    BLUE,
    CHANGE_MAP,
    CONTACT,
    GREY,
    MM_TO_UM,
    PALE,
    VERMILION,
    WIDTH,
    block_of,
    draw_heights,
    draw_map,
    draw_mask,
    height_limits,
    legend_below,
    new_figure,
    scale_bar,
    styled,
    thickened_note,
    write_notes,
)

__all__ = [
    "overview_figure",
    "patch_figure",
    "published_figure",
    "truth_figure",
]


@styled
def patch_figure(
    contact: xr.Dataset,
    registered: xr.Dataset,
    *,
    patch: str,
    source_note: str | None = None,
) -> Figure:
    """One patch before use, predicted, and after use (Fig. 11); below, what was measured.

    Parameters
    ----------
    contact : xarray.Dataset
        ``height`` (T0) and ``pressure`` (y, x) of the final state.
    registered : xarray.Dataset
        ``t1``, ``change``, ``loss``, ``gain`` (y, x), the attribute ``level_of_detection_um``.
    patch : str
        Its id, for the title.
    """
    panel = WIDTH / 3
    figure = new_figure(WIDTH, 0.86 * WIDTH)
    figure.suptitle(
        f"patch {patch}: {float(contact['mean_pressure'][-1]):.1f} MPa, "
        f"T1 covers {registered.attrs.get('overlap', math.nan):.0%} of T0"
    )
    (before, predicted, after), (changed, lost, agreement) = figure.subplots(2, 3)
    t0, t1, change = contact["height"], registered["t1"], registered["change"]
    in_contact = contact["pressure"].values > 0
    loss = registered["loss"].values.astype(bool)
    inside = np.isfinite(change.values)
    block = block_of(t0.shape, 0.9 * panel)

    limits = height_limits(t0, t1)
    draw_heights(before, t0, limits=limits, ticks=False)
    image = draw_heights(after, t1, limits=limits, ticks=False)
    _bar(figure, image, before, "height (µm)")
    _bar(figure, image, after, "height (µm)")
    before.set_title("T0, before use")
    after.set_title("T1, after use")
    scale_bar(before, 0.2)

    draw_heights(predicted, t0, relief=True, ticks=False)
    draw_mask(predicted, t0, in_contact, CONTACT, block=block, thicken=True)
    predicted.set_title("predicted contact")
    legend_below(predicted, [Patch(color=CONTACT, label=f"in contact: {in_contact.mean():.2%}")])

    limit = registered.attrs["level_of_detection_um"]  # NaN where no change is known
    bound = np.nanmax([-height_limits(change)[0], 2 * limit])
    # what noise may have done is drawn as no change
    counted = loss | registered["gain"].values.astype(bool)
    image = draw_map(
        changed,
        t0,
        np.where(counted, change.values, 0 * change.values) * MM_TO_UM,
        cmap=CHANGE_MAP,
        limits=(-bound, bound),
        ticks=False,
    )
    draw_mask(changed, t0, ~inside, "white", block=block)
    _bar(figure, image, changed, "height change (µm), 0 where not detected")
    changed.set_title("measured change T1 − T0")

    for axes in (lost, agreement):
        draw_heights(axes, t0, relief=True, ticks=False)
        draw_mask(axes, t0, ~inside, "white", block=block)
    draw_mask(lost, t0, loss, VERMILION, block=block)
    lost.set_title("measured loss")
    share = loss.sum() / max(inside.sum(), 1)
    told = f"lost more than {limit:.2f} µm: {share:.1%}" if inside.any() else "change not known"
    legend_below(lost, [Patch(color=VERMILION if inside.any() else "white", label=told)])

    classes = draw_agreement(agreement, contact, registered, block=block)
    handles = [
        Patch(color=colour, label=f"{name} {mask.sum() / max(inside.sum(), 1):.1%}")
        for name, (mask, colour) in classes.items()
    ]
    agreement.set_title("agreement")
    for axes in (before, predicted, after, changed, lost, agreement):
        axes.set_anchor("N")
    legend_below(agreement, handles[::-1])
    write_notes(figure, source_note, ["Bare: change not known.", thickened_note(block)])
    return figure


def _bar(figure: Figure, image, axes: Axes, label: str) -> None:
    bar = figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.8, pad=0.02, aspect=25)
    bar.ax.tick_params(labelsize=6)
    bar.set_label(label, fontsize=6.5, labelpad=1)


@styled
def truth_figure(truth: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """What every stage recovered of the generated specimen, against what is true.

    One panel for each stage and quantity: recovered against true, or against the patch where the
    truth is the same for all.

    Parameters
    ----------
    truth : pandas.DataFrame
        ``truth.csv``: ``stage, quantity, patch, unit, true, recovered``.
    """
    truth = truth.dropna(subset=["true", "recovered"])
    groups = list(truth.groupby(["stage", "quantity"], sort=False))
    columns = min(4, max(1, len(groups)))
    rows = max(1, math.ceil(len(groups) / columns))
    figure = new_figure(WIDTH, rows * WIDTH / 4 * 1.1 + 0.2)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, ((stage, quantity), group) in zip(grid.flat, groups, strict=False):
        _truth_panel(axes, group)
        axes.set_title(f"{stage}\n{quantity}", fontsize=7)
        axes.tick_params(labelsize=6)
    for axes in grid.flat[len(groups) :]:
        axes.set_axis_off()
    write_notes(figure, source_note, ["Grey line: recovered without error."])
    return figure


def _truth_panel(axes: Axes, group: pd.DataFrame) -> None:
    unit = str(group["unit"].iloc[0])
    suffix = f" ({unit.replace('um', 'µm')})" if unit not in ("1", "", "nan") else ""
    true, recovered = group["true"].to_numpy(float), group["recovered"].to_numpy(float)
    line = {"color": GREY, "lw": 0.8, "zorder": 0}
    points = {"marker": "o", "ls": "none", "color": BLUE, "alpha": 0.8, "markersize": 3}
    if np.ptp(true) > 0:
        axes.axline((float(true[0]), float(true[0])), slope=1, **line)
        axes.plot(true, recovered, **points)
        axes.set_xlabel(f"true{suffix}", fontsize=6.5)
    else:
        axes.axhline(float(true[0]), **line)
        axes.plot(np.arange(len(group)), recovered, **points)
        if len(group) > 1:
            axes.set_xlabel("scan", fontsize=6.5)
        axes.set_xticks([])
    axes.set_ylabel(f"recovered{suffix}", fontsize=6.5)
    axes.margins(0.15)


@styled
def published_figure(table: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """Published figures beside the computed ones, one panel for each unit.

    Parameters
    ----------
    table : pandas.DataFrame
        ``published.csv``: ``quantity, patch, unit, published, computed``.
    """
    units = list(table.groupby("unit", sort=False))
    counts = [len(rows) for _, rows in units]
    figure = new_figure(0.8 * WIDTH, 0.22 * sum(counts) + 0.55 * len(units) + 0.4)
    panels = figure.subplots(len(units), 1, squeeze=False, height_ratios=[c + 1 for c in counts])
    for axes, (unit, rows) in zip(panels.flat, units, strict=True):
        places = np.arange(len(rows))
        axes.hlines(places, rows["published"], rows["computed"], color=PALE, lw=3, zorder=0)
        axes.plot(rows["published"], places, "D", mfc="white", color=GREY, label="published")
        axes.plot(rows["computed"], places, "o", color=BLUE, label="computed")
        patches = rows["patch"].fillna("").astype(str)
        names = [
            f"{quantity} {patch}".strip()
            for quantity, patch in zip(rows["quantity"], patches, strict=True)
        ]
        axes.set_yticks(places, names)
        axes.invert_yaxis()
        axes.margins(y=0.5 / max(len(rows), 1))
        axes.set_xlim(0, 1.06 * max(rows["published"].max(), rows["computed"].max()))
        axes.set_xlabel("share" if str(unit) == "1" else str(unit).replace("um", "µm"))
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    write_notes(figure, source_note)
    return figure


@styled
def overview_figure(
    macroscale: xr.Dataset,
    pressures: pd.DataFrame,
    contact: xr.Dataset,
    registered: xr.Dataset | None,
    *,
    patch: str,
    patch_size_mm: float,
    source_note: str | None = None,
) -> Figure:
    """The study at a glance: square in contact, forces, one patch's contact, measured loss.

    Parameters
    ----------
    macroscale : xarray.Dataset
        ``height`` (y, x), ``pressure`` (step, y, x).
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, pressure_MPa, in_study``.
    contact, registered : xarray.Dataset
        The patch to show: as for `patch_figure`; without T1 the last panel is left out.
    patch : str
        Its id.
    patch_size_mm : float
        Side of a patch.
    """
    panels = 3 if registered is None else 4
    width = 11.0
    side = width / 4
    figure = new_figure(side * panels, side * 1.29)
    axes = figure.subplots(1, panels)
    last = macroscale.isel(step=-1)
    draw_heights(axes[0], macroscale["height"], relief=True, ticks=False)
    draw_mask(axes[0], macroscale["height"], last["pressure"].values > 0, CONTACT)
    scale_bar(axes[0], 1)
    axes[0].set_title(
        f"1  the square in contact\n{float(last['mean_pressure']):.3g} MPa on average"
    )
    draw_forces(axes[1], macroscale, ticks=False)
    shown = pressures[pressures["patch"] == patch]
    others = pressures[(pressures["patch"] != patch) & pressures["in_study"]]
    draw_footprints(axes[1], others, patch_size_mm, colour=BLUE)
    draw_footprints(axes[1], shown, patch_size_mm, colour=VERMILION)
    axes[1].set_title(
        f"2  forces under the scans\npatch {patch}: {shown['pressure_MPa'].iloc[0]:.1f} MPa"
    )

    t0, in_contact = contact["height"], contact["pressure"].values > 0
    block = block_of(t0.shape, 0.9 * side)
    draw_heights(axes[2], t0, relief=True, ticks=False)
    draw_mask(axes[2], t0, in_contact, CONTACT, block=block, thicken=True)
    scale_bar(axes[2], 0.2)
    axes[2].set_title(f"3  predicted contact, patch {patch}\n{in_contact.mean():.1%} of its area")
    if registered is not None:
        inside = np.isfinite(registered["change"].values)
        draw_heights(axes[3], t0, relief=True, ticks=False)
        draw_mask(axes[3], t0, ~inside, "white", block=block)
        classes = draw_agreement(axes[3], contact, registered, block=block)
        axes[3].set_title("4  measured loss\nagainst the prediction")
        legend_below(
            axes[3],
            [Patch(color=colour, label=name) for name, (_, colour) in reversed(classes.items())],
        )
    write_notes(
        figure,
        source_note,
        ["Grey: height; forces from white (0) to black.", thickened_note(block)],
    )
    return figure
