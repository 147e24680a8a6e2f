"""Where the patches lie on the square: each one's waves against the macroscale's under it."""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse

from gstlib.figures.macroscale import draw_footprints
from gstlib.figures.style import (
    BLUE,
    CONTACT,
    GREY,
    PRESSURE_MAP,
    VERMILION,
    WIDTH,
    draw_heights,
    draw_map,
    height_limits,
    new_figure,
    scale_bar,
    styled,
    write_notes,
)
from gstlib.placement import AGREES, ALL, CANNOT_TELL, SHIFTED
from gstlib.surface import make_surface

__all__ = ["placement_figure"]

_COLOURS = {AGREES: BLUE, SHIFTED: VERMILION, CANNOT_TELL: GREY}
# Arrows are drawn so many times longer than the shifts: these are far smaller than the square.
_LONGER = 5
_SHOWN = 3


@styled
def placement_figure(
    height: xr.DataArray,
    patches: pd.DataFrame,
    placement: pd.DataFrame,
    maps: xr.Dataset,
    *,
    patch_size_mm: float,
    source_note: str | None = None,
) -> Figure:
    """Nominal places and shifts found, and the waves of the patches that tell most.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        Levelled heights of the square, mm, in the square's frame.
    patches : pandas.DataFrame
        Nominal places: ``patch, x_mm, y_mm``, optionally ``rotation_deg``.
    placement : pandas.DataFrame
        Table of `gstlib.placement.place_patches`.
    maps : xarray.Dataset
        What `gstlib.placement.place_patches` gives with it.
    patch_size_mm : float
        Side of a patch.
    """
    rows = placement.set_index("patch")
    shown = _telling(rows)
    looks = rows.looks[ALL]
    figure = new_figure(WIDTH, 0.5 * WIDTH + len(shown) * 0.24 * WIDTH + 0.2)
    above, *below = np.atleast_1d(
        figure.subfigures(2, 1, height_ratios=[0.5, 0.24 * len(shown)]) if shown else figure
    )
    square, scatter = above.subplots(1, 2, width_ratios=[1, 0.8])
    draw_heights(square, height, relief=True)
    for verdict, colour in _COLOURS.items():
        ids = rows.index[rows.verdict == verdict]
        some = patches[patches.patch.isin(ids)]
        draw_footprints(square, some, patch_size_mm, colour=colour, label_all=True)
    _arrows(square, patches, rows)
    _scatter(scatter, rows, float(maps.shift_x[-1]))
    if shown:
        _strips(below[0], shown, rows, maps)
    write_notes(
        figure,
        source_note,
        [
            f"Arrows: shifts, {_LONGER} times as long.",
            "Bars and ellipses: one standard error. Cross: nominal place." if shown else "",
            f"Patches look {looks}." if isinstance(looks, str) and looks else "",
        ],
    )
    return figure


def _telling(rows: pd.DataFrame) -> list[str]:
    """The patches to show: those found elsewhere, then those that correlate best."""
    known = rows.drop(index=ALL).dropna(subset=["shift_x_um"])
    order = known.assign(off=known.verdict != SHIFTED, loose=-known.correlation)
    return list(order.sort_values(["off", "loose"], kind="stable").index[:_SHOWN])


def _arrows(axes: Axes, patches: pd.DataFrame, rows: pd.DataFrame) -> None:
    for patch in patches.itertuples(index=False):
        row = rows.loc[patch.patch]
        if not np.isfinite(row.shift_x_um):
            continue
        axes.annotate(
            "",
            (
                patch.x_mm + _LONGER * row.shift_x_um * 1e-3,
                patch.y_mm + _LONGER * row.shift_y_um * 1e-3,
            ),
            (patch.x_mm, patch.y_mm),
            arrowprops={
                "arrowstyle": "->",
                "color": _COLOURS[row.verdict],
                "lw": 1.0,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            annotation_clip=False,
        )


def _scatter(axes: Axes, rows: pd.DataFrame, limit_um: float) -> None:
    """Shifts with their errors, all patches together last."""
    for verdict, colour in _COLOURS.items():
        some = rows[(rows.verdict == verdict) & (rows.index != ALL)]
        axes.errorbar(
            some.shift_x_um,
            some.shift_y_um,
            some.shift_y_error_um,
            some.shift_x_error_um,
            fmt="o",
            color=colour,
            markersize=3,
            lw=0.5,
        )
        for patch, row in some.dropna(subset=["shift_x_um"]).iterrows():
            axes.annotate(
                patch,
                (row.shift_x_um, row.shift_y_um),
                xytext=(2.5, 2.5),
                textcoords="offset points",
                fontsize=6,
                color=colour,
            )
    together = rows.loc[ALL]
    axes.errorbar(
        together.shift_x_um,
        together.shift_y_um,
        together.shift_y_error_um,
        together.shift_x_error_um,
        fmt="D",
        color=CONTACT,
        markersize=4,
        lw=1,
    )
    axes.axhline(0, color=GREY, lw=0.5, zorder=0)
    axes.axvline(0, color=GREY, lw=0.5, zorder=0)
    # as on the map: x to the left, y downwards
    axes.set(
        xlim=(limit_um, -limit_um),
        ylim=(limit_um, -limit_um),
        aspect="equal",
        xlabel="shift along x (µm)",
        ylabel="shift along y (µm)",
    )
    counts = rows.drop(index=ALL).verdict.value_counts()
    dots = {
        f"{verdict}: {counts.get(verdict, 0)}": {"marker": "o", "color": colour}
        for verdict, colour in _COLOURS.items()
    }
    dots["all together"] = {"marker": "D", "color": CONTACT}
    axes.legend(
        handles=[Line2D([], [], ls="none", label=label, **dot) for label, dot in dots.items()],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=2,
    )


def _strips(figure, shown: list[str], rows: pd.DataFrame, maps: xr.Dataset) -> None:
    """A row for each patch: its waves, the macroscale's under both places, the correlation."""
    grid = figure.subplots(len(shown), 4, squeeze=False)
    step = maps.shift_x.attrs["spacing"]
    for panels, patch in zip(grid, shown, strict=True):
        of_patch, row = maps.sel(patch=patch), rows.loc[patch]
        titles = {
            "patch_waves": f"patch {patch}",
            "nominal_waves": f"nominal place, r = {row.correlation_nominal:.2f}",
            "found_waves": f"best place, r = {row.correlation:.2f}",
        }
        limits = height_limits(*(of_patch[name] for name in titles))
        for axes, (name, title) in zip(panels, titles.items(), strict=False):
            image = draw_heights(axes, of_patch[name], limits=limits, ticks=False)
            axes.set_title(title, fontsize=7)
        bar = figure.colorbar(image, ax=panels[2], shrink=0.75, pad=0.02)
        bar.ax.tick_params(labelsize=6)
        bar.set_label("µm", fontsize=6.5, labelpad=1)
        count = of_patch.sizes["shift_x"]
        shifts = make_surface(np.zeros((count, count)), step, origin=[-count * step / 2] * 2)
        image = draw_map(
            panels[3],
            shifts,
            of_patch["correlation"].values,
            cmap=PRESSURE_MAP,
            limits=(None, 1),
            ticks=False,
        )
        bar = figure.colorbar(image, ax=panels[3], shrink=0.75, pad=0.02)
        bar.ax.tick_params(labelsize=6)
        panels[3].set_title(
            f"shift {row.shift_x_um:.0f}, {row.shift_y_um:.0f} µm: {row.verdict}", fontsize=7
        )
        panels[3].plot(0, 0, marker="+", color=CONTACT, markersize=6)
        panels[3].add_patch(
            Ellipse(
                (row.shift_x_um, row.shift_y_um),
                2 * row.shift_x_error_um,
                2 * row.shift_y_error_um,
                fill=False,
                lw=1,
            )
        )
    scale_bar(grid[0, 0], 0.2)
    reach = float(maps.shift_x[-1])
    for axes in grid[:, 3]:
        axes.set_yticks([-reach, 0, reach], [f"{reach:+.0f} µm", "0", f"{-reach:+.0f} µm"][::-1])
        axes.tick_params(labelsize=6)
