"""The patches: how a scan was cleaned, and how each is pressed (the paper's Figs. 9 and 10)."""

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gstlib.figures.style import (
    BLUE,
    CONTACT,
    GREY,
    MM_TO_UM,
    PALE,
    PRESSURE_MAP,
    VERMILION,
    WIDTH,
    block_of,
    draw_heights,
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
    "microscale_curves_figure",
    "microscale_maps_figure",
    "preparation_figure",
]


@styled
def preparation_figure(
    prepared: Mapping[str, xr.Dataset],
    measured: Mapping[str, xr.DataArray],
    *,
    patch: str,
    source_note: str | None = None,
) -> Figure:
    """A patch's scans as measured and as prepared, and what was changed; one row an epoch.

    Parameters
    ----------
    prepared : mapping of epoch to xarray.Dataset
        ``height`` (mm), ``filled``, ``outlier`` (y, x) and the attributes ``tilt_x_mrad``,
        ``tilt_y_mrad``.
    measured : mapping of epoch to (y, x) xarray.DataArray
        The same scans as measured, turned back from the mould, mm, NaN where unmeasured.
    patch : str
        Its id, for the title.
    """
    rows = len(prepared)
    figure = new_figure(WIDTH, rows * 0.32 * WIDTH + 0.35)
    figure.suptitle(f"patch {patch}")
    grid = figure.subplots(rows, 4, squeeze=False)
    block = 1
    for axes, (epoch, surface) in zip(grid, prepared.items(), strict=True):
        raw, height = measured[epoch], surface["height"]
        filled, outlier = surface["filled"].values, surface["outlier"].values
        block = block_of(height.shape, 0.2 * WIDTH)
        for place, values, limits in (
            (axes[0], raw, height_limits(raw)),
            (axes[1], height, height_limits(height)),
        ):
            image = draw_heights(place, values, limits=limits, ticks=False)
            bar = figure.colorbar(image, ax=place, shrink=0.75, pad=0.02)
            bar.ax.tick_params(labelsize=6)
            bar.set_label("µm", fontsize=6.5, labelpad=1)
        draw_heights(axes[2], height, relief=True, ticks=False)
        draw_mask(axes[2], height, filled, BLUE, block=block)
        draw_mask(axes[2], height, outlier, VERMILION, block=block)
        axes[0].set_title(f"{epoch}, as measured")
        axes[1].set_title(
            f"prepared, tilt {surface.attrs['tilt_x_mrad']:.2f}, "
            f"{surface.attrs['tilt_y_mrad']:.2f} mrad",
            fontsize=7,
        )
        axes[2].set_title("points replaced")
        legend_below(
            axes[2],
            [
                Patch(color=BLUE, label=f"unmeasured: {filled.mean():.2%}"),
                Patch(color=VERMILION, label=f"outliers: {outlier.mean():.2%}"),
            ],
            columns=1,
        )
        scale_bar(axes[0], 0.2)
        _height_histogram(axes[3], raw, height)
    write_notes(figure, source_note, ["Colours are scaled to each map."])
    return figure


def _height_histogram(axes, raw: xr.DataArray, height: xr.DataArray) -> None:
    before = raw.values[np.isfinite(raw.values)] * MM_TO_UM
    after = height.values.ravel() * MM_TO_UM
    before = before - np.median(before)
    low, high = min(before.min(), after.min()), max(before.max(), after.max())
    bins = np.linspace(low, high if high > low else low + 1, 80)
    axes.hist(before, bins, color=PALE, edgecolor=GREY, histtype="stepfilled", label="measured")
    axes.hist(after, bins, color=BLUE, histtype="step", label="prepared")
    axes.set_yscale("log")
    axes.set(xlabel="height (µm)", title="number of points")
    axes.tick_params(labelsize=6)
    axes.legend(
        fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.27), ncols=2, handlelength=1
    )


@styled
def microscale_maps_figure(
    contacts: Mapping[str, xr.Dataset], *, columns: int = 4, source_note: str | None = None
) -> Figure:
    """Contact on every patch at its own pressure (Fig. 9).

    Parameters
    ----------
    contacts : mapping of patch to xarray.Dataset
        ``height``, ``pressure`` (y, x) of the final state and the load path (step).
    """
    columns = max(1, min(columns, len(contacts)))
    rows = max(1, math.ceil(len(contacts) / columns))
    panel = WIDTH / max(columns, 3)
    figure = new_figure(columns * panel, rows * panel * 1.14 + 0.2)
    grid = figure.subplots(rows, columns, squeeze=False)
    block = 1
    for axes, (patch, contact) in zip(grid.flat, contacts.items(), strict=False):
        height, pressure = contact["height"], contact["pressure"].values
        block = max(block, block_of(height.shape, 0.95 * panel))
        draw_heights(axes, height, relief=True, ticks=False)
        draw_mask(axes, height, pressure > 0, CONTACT, block=block, thicken=True)
        axes.set_title(
            f"patch {patch}: {float(contact['mean_pressure'][-1]):.1f} MPa, "
            f"{(pressure > 0).mean():.2%}",
            fontsize=7,
        )
    for axes in grid.flat[len(contacts) :]:
        axes.set_axis_off()
    if contacts:
        scale_bar(grid.flat[0], 0.2)
    write_notes(figure, source_note, ["Black: in contact; grey: height.", thickened_note(block)])
    return figure


@styled
def microscale_curves_figure(
    contacts: Mapping[str, xr.Dataset], *, source_note: str | None = None
) -> Figure:
    """Contact area, pressure and stiffness of every patch along its load path (Fig. 10).

    Parameters
    ----------
    contacts : mapping of patch to xarray.Dataset
        Load paths (step) with the attribute ``contact_modulus_MPa``.
    """
    figure = new_figure(WIDTH, 0.4 * WIDTH)
    area, load, stiffness = figure.subplots(1, 3)
    reached = {patch: float(c["mean_pressure"][-1]) for patch, c in contacts.items()}
    pressures = list(reached.values()) or [1.0]
    norm = Normalize(0, max(pressures))
    for patch, contact in contacts.items():
        colour = PRESSURE_MAP(norm(reached[patch]))
        pressure = contact["mean_pressure"].values
        displacement = contact["displacement"].values * MM_TO_UM
        curves = (
            (
                area,
                pressure / contact.attrs["contact_modulus_MPa"],
                contact["contact_fraction"].values * 100,
            ),
            (load, displacement, pressure),
            (stiffness, pressure, contact["stiffness"].values / MM_TO_UM),
        )
        for axes, x, y in curves:
            axes.plot(x, y, color=colour, marker=".", markersize=2, lw=1)
            axes.annotate(
                patch,
                (x[-1], y[-1]),
                xytext=(2, 0),
                textcoords="offset points",
                fontsize=6,
                va="center",
                color=colour,
            )
    area.set(xlabel="F / (E* Aₙ)", ylabel="real contact area A / Aₙ (%)", title="(a)")
    area.ticklabel_format(axis="x", style="sci", scilimits=(0, 0), useMathText=True)
    load.set(xlabel="far-field displacement (µm)", ylabel="mean pressure (MPa)", title="(b)")
    stiffness.set(xlabel="mean pressure (MPa)", ylabel="stiffness (MPa/µm)", title="(c)")
    for axes in (area, load, stiffness):
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
    figure.colorbar(
        ScalarMappable(norm, PRESSURE_MAP),
        ax=stiffness,
        label="patch pressure (MPa)",
        aspect=30,
    )
    write_notes(figure, source_note, ["Curves end at the patch's number."])
    return figure
