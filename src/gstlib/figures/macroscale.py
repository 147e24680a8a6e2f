"""The square and how it is pressed (the paper's Figs. 5 to 8, Table 1)."""

import math

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from gstlib.figures.style import (
    AMBER,
    BLUE,
    CONTACT,
    FORCE_MAP,
    GREY,
    LEGIBLE,
    MM_TO_UM,
    VERMILION,
    WIDTH,
    draw_heights,
    draw_map,
    draw_mask,
    name_patches,
    new_figure,
    styled,
    write_notes,
)
from gstlib.surface import spacing_of

# Under labels on the force map, which has dark spots
_LABEL_BOX = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6}

__all__ = [
    "contact_steps_figure",
    "draw_footprints",
    "draw_forces",
    "elastic_rigid_figure",
    "force_figure",
    "macroscale_curves_figure",
    "mark_origin",
    "patch_pressure_figure",
]


@styled
def contact_steps_figure(
    contact: xr.Dataset, *, panels: int = 9, source_note: str | None = None
) -> Figure:
    """Contact as the far-field displacement grows (Fig. 5).

    Parameters
    ----------
    contact : xarray.Dataset
        ``height``, ``pressure`` (step, y, x), ``displacement``, ``mean_pressure``,
        ``contact_fraction`` (step).
    panels : int
        Number of steps shown, evenly spread, the last one among them.
    """
    steps = np.unique(np.linspace(0, contact.sizes["step"] - 1, panels).round().astype(int))
    columns = min(3, len(steps))
    rows = math.ceil(len(steps) / columns)
    figure = new_figure(WIDTH, rows * WIDTH / columns * 1.1)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, step in zip(grid.flat, steps, strict=False):
        state = contact.isel(step=step)
        draw_heights(axes, contact["height"], relief=True)
        draw_mask(axes, contact["height"], state["pressure"].values > 0, CONTACT)
        axes.set_title(
            f"δ = {float(state['displacement']) * MM_TO_UM:.1f} µm\n"
            f"p̄ = {float(state['mean_pressure']):.3g} MPa, "
            f"contact {float(state['contact_fraction']):.1%}"
        )
    _tidy_grid(grid, len(steps))
    write_notes(figure, source_note, ["Black: in contact; grey: height."])
    return figure


@styled
def elastic_rigid_figure(contact: xr.Dataset, *, source_note: str | None = None) -> Figure:
    """Elastic contact against rigid interpenetration at the last step (Fig. 6)."""
    height, last = contact["height"], contact.isel(step=-1)
    elastic = last["pressure"].values > 0
    rigid = (height > height.max() - last["displacement"]).values
    figure = new_figure(0.72 * WIDTH, 0.72 * WIDTH)
    axes = figure.subplots()
    draw_heights(axes, height, relief=True)
    draw_mask(axes, height, rigid, AMBER)
    draw_mask(axes, height, elastic, CONTACT)
    axes.set_title(
        f"δ = {float(last['displacement']) * MM_TO_UM:.1f} µm, "
        f"p̄ = {float(last['mean_pressure']):.3g} MPa"
    )
    axes.legend(
        handles=[
            Patch(color=CONTACT, label=f"elastic contact: {elastic.mean():.1%}"),
            Patch(color=AMBER, label=f"rigid interpenetration: {rigid.mean():.1%}, black included"),
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.1),
        ncols=2,
    )
    write_notes(figure, source_note, ["Grey: height."])
    return figure


@styled
def macroscale_curves_figure(contact: xr.Dataset, *, source_note: str | None = None) -> Figure:
    """Contact area against load, and pressure against displacement (Fig. 7).

    Parameters
    ----------
    contact : xarray.Dataset
        Load path (step) with the attribute ``contact_modulus_MPa``.
    """
    figure = new_figure(WIDTH, 0.4 * WIDTH)
    area, load = figure.subplots(1, 2)
    style = {"marker": "o", "color": BLUE}
    dimensionless = contact["mean_pressure"].values / contact.attrs["contact_modulus_MPa"]
    area.plot(dimensionless, contact["contact_fraction"].values * 100, **style)
    area.set(xlabel="F / (E* Aₙ)", ylabel="real contact area A / Aₙ (%)", title="(a)")
    area.ticklabel_format(axis="x", style="sci", scilimits=(0, 0), useMathText=True)
    load.plot(contact["displacement"].values * MM_TO_UM, contact["mean_pressure"].values, **style)
    load.set(xlabel="far-field displacement (µm)", ylabel="mean pressure (MPa)", title="(b)")
    for axes in (area, load):
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
    write_notes(figure, source_note)
    return figure


@styled
def force_figure(
    contact: xr.Dataset,
    pressures: pd.DataFrame,
    *,
    patch_size_mm: float,
    source_note: str | None = None,
) -> Figure:
    """Contact force of each element at the last step, with the patches' pressures (Fig. 8)."""
    figure = new_figure(0.78 * WIDTH, 0.68 * WIDTH)
    axes = figure.subplots()
    image = draw_forces(axes, contact)
    figure.colorbar(image, ax=axes, label="contact force per element (N)", shrink=0.9)
    draw_footprints(axes, pressures, patch_size_mm, colour=BLUE, show_pressure=True)
    last = contact.isel(step=-1)
    axes.set_title(f"δ = {float(last['displacement']) * MM_TO_UM:.1f} µm")
    write_notes(
        figure, source_note, ["In the outlines: patch and its pressure in MPa; dashed: left out."]
    )
    return figure


def draw_forces(axes: Axes, contact: xr.Dataset, *, ticks: bool = True):
    """Force (N) on each element at the last step, on a square-root scale."""
    dy, dx = spacing_of(contact)
    force = contact["pressure"].isel(step=-1).values * dy * dx
    norm = PowerNorm(0.5, vmin=0, vmax=float(force.max()) or 1.0)
    return draw_map(
        axes,
        contact["height"],
        force,
        cmap=FORCE_MAP,
        norm=norm,
        interpolation="nearest",
        ticks=ticks,
    )


@styled
def patch_pressure_figure(pressures: pd.DataFrame, *, source_note: str | None = None) -> Figure:
    """Nominal pressure of every patch, in and out of the study (Table 1), with its interval.

    Parameters
    ----------
    pressures : pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa, in_study``.
    """
    figure = new_figure(WIDTH, 0.36 * WIDTH)
    axes = figure.subplots()
    places = np.arange(len(pressures))
    chosen = pressures["in_study"].to_numpy(dtype=bool)
    values = pressures["pressure_MPa"].to_numpy(dtype=float)
    axes.bar(places[chosen], values[chosen], color=BLUE, label="in the study")
    axes.bar(
        places[~chosen],
        values[~chosen],
        facecolor="none",
        edgecolor=GREY,
        linewidth=0.8,
        label="left out",
    )
    low, high = (pressures[f"{end}_MPa"].to_numpy(dtype=float) for end in ("low", "high"))
    axes.vlines(places, low, high, color="black", linewidth=0.7)
    name_patches(axes, pressures["patch"])
    axes.tick_params(axis="x", length=0)
    axes.set(ylabel="nominal pressure (MPa)", xlim=(-0.7, len(places) - 0.3))
    if len(places) <= LEGIBLE:
        axes.bar_label(
            axes.bar(places, np.maximum(values, high), alpha=0),
            labels=[f"{value:.1f}" if value > 0 else "0" for value in values],
            fontsize=6,
            padding=1,
            color=GREY,
        )
    axes.legend()
    write_notes(figure, source_note, ["Lines: 95 % interval by place and elastic constants."])
    return figure


def draw_footprints(
    axes: Axes,
    pressures: pd.DataFrame,
    patch_size_mm: float,
    *,
    colour: str,
    label_all: bool = False,
    show_pressure: bool = False,
) -> None:
    """Outline the patches: solid and bold in the study, dashed and thin out of it.

    Before it is known which are (no column ``in_study``), all are solid. Of more patches than are
    `LEGIBLE` no pressures are written.
    """
    show_pressure = show_pressure and len(pressures) <= LEGIBLE
    half = patch_size_mm / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    for row in pressures.itertuples(index=False):
        turn = math.radians(float(getattr(row, "rotation_deg", 0.0)))
        turned = corners @ [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
        chosen = bool(getattr(row, "in_study", True))
        outline = turned + np.array([row.x_mm, row.y_mm])
        axes.add_patch(
            Polygon(
                outline,
                closed=True,
                fill=False,
                edgecolor=colour,
                linewidth=1.1 if chosen else 0.6,
                linestyle="-" if chosen else (0, (4, 3)),
            )
        )
        if chosen or label_all or show_pressure:
            text = f"{row.patch}"
            if show_pressure:
                text += f": {row.pressure_MPa:.1f}"
            axes.text(
                # x runs to the left: the larger x is the outline's left edge as drawn
                row.x_mm + half * 0.92,
                row.y_mm - half * 0.9,
                text,
                ha="left",
                va="top",
                fontsize=6.5,
                color=colour,
                fontweight="bold" if chosen else "normal",
                bbox=None if colour == "white" else _LABEL_BOX,
            )


def mark_origin(axes: Axes) -> None:
    """Mark the reference corner, from which places are measured."""
    axes.add_line(Line2D([0], [0], marker="o", markersize=5, color=VERMILION, clip_on=False))
    axes.annotate(
        "reference corner",
        (0, 0),
        xytext=(-2, 5),
        textcoords="offset points",
        ha="right",
        fontsize=6.5,
        color=VERMILION,
        annotation_clip=False,
    )


def _tidy_grid(grid: np.ndarray, used: int) -> None:
    """Keep labels on the outer panels only, and drop the panels without content."""
    for axes in grid.flat[used:]:
        axes.set_axis_off()
    for axes in grid.flat[:used]:
        axes.label_outer()
