"""The patches: how each is pressed (the paper's Figs. 9 and 10)."""

import math
from collections.abc import Mapping, Sequence

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gstlib.figures.style import (
    BLUE,
    CONTACT,
    MM_TO_UM,
    PRESSURE_MAP,
    VERMILION,
    WIDTH,
    block_of,
    draw_classes,
    draw_heights,
    draw_mask,
    new_figure,
    scale_bar,
    styled,
    thickened_note,
    write_notes,
)

__all__ = [
    "hardness_figure",
    "microscale_curves_figure",
    "microscale_maps_figure",
    "slip_figure",
]


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
    figure, panels, block = _small_multiples(
        {patch: contact["height"] for patch, contact in contacts.items()}, columns
    )
    for axes, (patch, contact) in zip(panels, contacts.items(), strict=True):
        in_contact = contact["pressure"].values > 0
        draw_mask(axes, contact["height"], in_contact, CONTACT, block=block, thicken=True)
        reached = float(contact["mean_pressure"][-1])
        axes.set_title(f"patch {patch}: {reached:.1f} MPa, {in_contact.mean():.2%}", fontsize=7)
    write_notes(figure, source_note, ["Black: in contact; grey: height.", thickened_note(block)])
    return figure


@styled
def slip_figure(
    heights: Mapping[str, xr.DataArray],
    slips: Mapping[str, xr.Dataset],
    *,
    columns: int = 4,
    source_note: str | None = None,
) -> Figure:
    """Where every patch sticks and slips under the tangential load.

    Parameters
    ----------
    heights : mapping of patch to (y, x) xarray.DataArray
        Heights of the patches, mm.
    slips : mapping of patch to xarray.Dataset
        ``stick``, ``slip`` (y, x), ``mean_traction`` and the attributes ``friction``,
        ``tangential_ratio``.
    """
    figure, panels, block = _small_multiples(heights, columns, room=0.25)
    load = ""
    for axes, (patch, slip) in zip(panels, slips.items(), strict=True):
        sticks, slides = slip["stick"].values, slip["slip"].values
        draw_classes(axes, heights[patch], {BLUE: sticks, VERMILION: slides}, block=block)
        axes.set_title(
            f"patch {patch}: {float(slip['mean_traction']):.1f} MPa, "
            f"slips {slides.sum() / max((slides | sticks).sum(), 1):.0%}",
            fontsize=7,
        )
        load = f"μ = {slip.attrs['friction']:g}, Q/μP = {slip.attrs['tangential_ratio']:g}."
    _legend_on_top(figure, [(BLUE, "sticks"), (VERMILION, "slips")])
    write_notes(
        figure,
        source_note,
        [load, "Titles: mean traction, share of contact.", thickened_note(block)],
    )
    return figure


@styled
def hardness_figure(
    contacts: Mapping[str, xr.Dataset],
    limited: Mapping[str, xr.Dataset],
    *,
    columns: int = 4,
    source_note: str | None = None,
) -> Figure:
    """Every patch's contact with a ceiling on its pressure, against the elastic one.

    Parameters
    ----------
    contacts : mapping of patch to xarray.Dataset
        ``height``, ``pressure`` (y, x) of the elastic contact.
    limited : mapping of patch to xarray.Dataset
        ``pressure`` (y, x) and the attribute ``hardness_MPa``.
    """
    figure, panels, block = _small_multiples(
        {patch: contact["height"] for patch, contact in contacts.items()}, columns, room=0.25
    )
    ceiling = ""
    for axes, (patch, contact) in zip(panels, contacts.items(), strict=True):
        hardness = limited[patch].attrs["hardness_MPa"]
        elastic, pressure = contact["pressure"].values > 0, limited[patch]["pressure"].values
        at_ceiling = pressure >= hardness
        below = (pressure > 0) & ~at_ceiling
        classes = {CONTACT: below & elastic, BLUE: below & ~elastic, VERMILION: at_ceiling}
        draw_classes(axes, contact["height"], classes, block=block)
        axes.set_title(
            f"patch {patch}: {elastic.mean():.2%} → {(pressure > 0).mean():.2%}", fontsize=7
        )
        ceiling = f"Ceiling: {hardness:g} MPa."
    _legend_on_top(
        figure,
        [
            (CONTACT, "in contact either way"),
            (VERMILION, "at the ceiling"),
            (BLUE, "only with the ceiling"),
        ],
    )
    write_notes(
        figure,
        source_note,
        [ceiling, "Titles: contact without and with it.", thickened_note(block)],
    )
    return figure


def _small_multiples(
    heights: Mapping[str, xr.DataArray], columns: int, room: float = 0.0
) -> tuple[Figure, Sequence[Axes], int]:
    """A pale relief of every patch, with `room` (inches) above; and the block to mark them by."""
    columns = max(1, min(columns, len(heights)))
    rows = max(1, math.ceil(len(heights) / columns))
    panel = WIDTH / max(columns, 3)
    figure = new_figure(columns * panel, rows * panel * 1.14 + 0.2 + room)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, height in zip(grid.flat, heights.values(), strict=False):
        draw_heights(axes, height, relief=True, ticks=False)
    for axes in grid.flat[len(heights) :]:
        axes.set_axis_off()
    if heights:
        scale_bar(grid.flat[0], 0.2)
    block = max((block_of(height.shape, 0.95 * panel) for height in heights.values()), default=1)
    return figure, list(grid.flat[: len(heights)]), block


def _legend_on_top(figure: Figure, classes: Sequence[tuple[str, str]]) -> None:
    figure.legend(
        handles=[Patch(color=colour, label=label) for colour, label in classes],
        loc="outside upper center",
        ncols=len(classes),
        handlelength=1,
    )


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
