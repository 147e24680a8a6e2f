"""The face: the square's heights, how the stone is pressed, and the forces under the patches.

The contact holds ``height`` (y, x), mm, ``path_pressure`` (step, y, x), MPa, and the load path
(step). Figures are those of the paper (3 to 8).
"""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gst.page.figures import maps, style
from gst.page.figures.maps import Map
from gst.page.figures.style import AMBER, BLACK, BLUE, GREY
from gst.page.results import Results
from gstlib.contact import Interface
from gstlib.surfaces.grid import MM_TO_UM, spacing_of

_STEPS = 8  # the most steps of a contact that are shown


def draw_places(
    axes: Axes, height: xr.DataArray, patches: pd.DataFrame, patch_mm: float
) -> None:
    """Draw the heights of the square (y, x), mm, and where the patches were scanned."""
    maps.draw_heights(axes, height)
    maps.draw_footprints(axes, patches, patch_mm, colour=BLACK)
    maps.mark_corner(axes)


def inputs_figure(study: Results) -> Figure:
    """Heights of the square, and where the patches were scanned (Fig. 3)."""
    figure, (axes,) = style.panels(1, 2)
    height = study.square("surface", "height").height
    draw_places(axes, height, study.outlined, study.patch_mm)
    return figure


def contact_steps_figure(study: Results) -> Figure:
    """Contact as the far-field displacement grows (Fig. 5); last, beside a rigid body's (Fig. 6).

    At most 8 steps are shown, evenly spaced, with the last. The square is outlined in the face.
    """
    contact = study.data("contact")
    height, drawn = contact.height, []
    area = height.size * np.prod(spacing_of(height))
    steps = np.linspace(0, contact.sizes["step"] - 1, _STEPS).round().astype(int)
    for step in np.unique(steps):
        state = contact.isel(step=step)
        title = (
            f"displacement {state.path_displacement * MM_TO_UM:.1f} µm\n"
            f"{style.short(state.path_mean_pressure * area)} N, "
            f"contact {100 * state.path_contact_fraction:.2f} %"
        )
        drawn.append(Map(title, height, marks={BLACK: state.path_pressure > 0}))
    elastic = contact.pressure > 0
    faces = Interface.from_dataset(contact).laid
    rigid = faces > faces.max() - contact.displacement
    title = (
        f"last step: contact {100 * elastic.mean():.2f} %\n"
        f"rigid interpenetration {100 * rigid.mean():.1f} %"
    )
    drawn.append(Map(title, height, marks={BLACK: elastic, AMBER: rigid & ~elastic}))
    figure = maps.draw_maps(drawn, 3)
    for panel in figure.axes:
        maps.outline_square(panel, study.size_mm)
    return figure


def exposure_figure(study: Results) -> Figure:
    """The effect of a gesture on the square, beside the single pose, and some of its poses.

    Where nothing is scanned, it is the effect on the face, with the square in it.
    """
    is_scanned = "places" not in study.tables
    data = study.square if is_scanned else study.data
    exposure, contact = data("exposure"), data("contact")
    fields = {
        "the single pose: pressure (MPa)": contact.pressure,
        "all poses: mean pressure (MPa)": exposure.mean_pressure,
        "highest pressure (MPa)": exposure.highest_pressure,
        "fraction of the poses that touch": exposure.touched,
    }
    drawn = [
        Map(title, field, maps.force_colours(field), bar="square-root scale")
        for title, field in fields.items()
    ]
    for pose, pressure in zip(exposure.shown.values, exposure.pressure, strict=True):
        touching = {BLACK: pressure > 0}
        drawn.append(Map(f"pose {pose + 1}", contact.height, marks=touching))
    figure = maps.draw_maps(drawn, 4)
    for panel in figure.axes[: len(fields)]:
        if is_scanned:
            patches = study.table("patch_pressures")
            maps.draw_footprints(panel, patches, study.patch_mm, colour=BLUE)
        else:
            maps.outline_square(panel, study.size_mm)
    return figure


def forces_figure(study: Results) -> Figure:
    """Contact forces at the last step (Fig. 8), and every patch's pressure (Table 1)."""
    figure, (square, bars) = style.panels(2, 2)
    contact = study.square("contact")
    pressures = study.table("patch_pressures")
    label = "contact force per element (N), square-root scale"
    maps.draw_forces(square, contact, bar=label, ticks=True)
    maps.draw_footprints(square, pressures, study.patch_mm, colour=BLUE)
    displacement_um = contact.displacement * MM_TO_UM
    square.set_title(f"displacement {displacement_um:.1f} µm", loc="right")
    maps.mark_corner(square)
    _draw_pressures(bars, pressures, study.table("patch_intervals"))
    return figure


def _draw_pressures(
    axes: Axes, pressures: pd.DataFrame, intervals: pd.DataFrame
) -> None:
    """The pressure of every patch with its interval; those left out of the study are open."""
    places, values = np.arange(len(pressures)), pressures.pressure_MPa
    left_out = values.where(~pressures.in_study)
    axes.bar(places, values.where(pressures.in_study), color=BLUE, label="in the study")
    axes.bar(places, left_out, color="none", edgecolor=GREY, label="left out")
    limits = intervals.set_index("patch").loc[pressures.patch]
    axes.vlines(places, limits.low_MPa, limits.high_MPa, color=BLACK, linewidth=0.7)
    style.name_patches(axes, list(pressures.patch))
    axes.set_ylabel("pressure (MPa), 95 % interval")
    axes.set_title("pressure of every patch")
    axes.legend()
