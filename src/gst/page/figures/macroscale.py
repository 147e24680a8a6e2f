"""The face: the square's heights, how the stone is pressed, and the forces under the patches.

The contact holds ``height`` (y, x), mm, ``path_pressure`` (step, y, x), MPa, and the load path
(step). Figures are those of the paper (3 to 8).
"""

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from gst.page.figures import maps, style
from gst.page.figures.style import AMBER, BLACK, BLUE, GREY, VERMILION, styled
from gstlib.contact import Interface
from gstlib.surfaces.footprints import PatchPosition, outline
from gstlib.surfaces.grid import MM_TO_UM, spacing_of

__all__ = ["contact_steps_figure", "draw_places", "exposure_figure", "force_figure"]
__all__ += ["input_figure"]


def draw_places(
    axes: Axes, height: xr.DataArray, patches: pd.DataFrame, patch_size_mm: float
) -> None:
    """Draw the heights of the square (y, x), mm, and where the patches were scanned."""
    maps.draw_map(axes, height, ticks=True, **maps.HEIGHTS)
    maps.draw_footprints(axes, patches, patch_size_mm, colour=BLACK)
    maps.mark_corner(axes)


@styled
def input_figure(
    height: xr.DataArray, patches: pd.DataFrame, *, patch_size_mm: float
) -> Figure:
    """Heights of the square (y, x), mm, and where the patches were scanned (Fig. 3)."""
    figure, (axes,) = style.panels(1, 2)
    draw_places(axes, height, patches, patch_size_mm)
    return figure


@styled
def contact_steps_figure(
    contact: xr.Dataset, *, size_mm: float, steps: int = 8
) -> Figure:
    """Contact as the far-field displacement grows (Fig. 5); last, beside a rigid body's (Fig. 6).

    `contact` is the face's, with the pressure at every step; at most `steps` of them are shown,
    evenly spaced, with the last. The square, of side `size_mm`, is outlined.
    """
    numbers = np.linspace(0, contact.sizes["step"] - 1, steps).round().astype(int)
    height, touching, drawn = contact["height"], contact["path_pressure"].values > 0, []
    area = height.size * float(np.prod(spacing_of(height)))
    for step in np.unique(numbers):
        state = contact.isel(step=step)
        displacement = float(state.path_displacement) * MM_TO_UM
        force = float(state.path_mean_pressure) * area
        percent = 100 * float(state.path_contact_fraction)
        title = (
            f"displacement {displacement:.1f} µm\n"
            f"{style.short(force)} N, contact {percent:.2f} %"
        )
        drawn.append((title, height, {"marks": {BLACK: touching[step]}}))
    faces, elastic = (
        Interface.from_dataset(contact).laid,
        contact["pressure"].values > 0,
    )
    rigid = (faces > faces.max() - contact["displacement"]).values
    touched, overlapping = 100 * elastic.mean(), 100 * rigid.mean()
    title = f"last step: contact {touched:.2f} %\nrigid interpenetration {overlapping:.1f} %"
    drawn.append((title, height, {"marks": {BLACK: elastic, AMBER: rigid & ~elastic}}))
    figure = maps.draw_maps(drawn, 3)
    square = outline(PatchPosition(size_mm / 2, size_mm / 2), size_mm)
    for panel in figure.axes:
        panel.add_patch(Polygon(square, fill=False, edgecolor=VERMILION, linewidth=0.7))
    return figure


@styled
def exposure_figure(
    exposure: xr.Dataset,
    contact: xr.Dataset,
    patches: pd.DataFrame,
    *,
    patch_size_mm: float,
) -> Figure:
    """The effect of a gesture on the square, beside the single pose, and some of its poses.

    `exposure` is from `gstlib.macroscale.gesture.exposure`; `contact` is the square's in the
    single pose.
    """
    height = contact["height"]
    single = contact["pressure"].values
    fields = {
        "the single pose: pressure (MPa)": single,
        "all poses: mean pressure (MPa)": exposure["mean_pressure"].values,
        "highest pressure (MPa)": exposure["highest_pressure"].values,
        "fraction of the poses that touch": exposure["touched"].values,
    }
    look = {"cmap": maps.FORCE_MAP, "bar": "square-root scale"}
    drawn = [
        (title, height, look | {"values": values, "norm": maps.force_norm(values)})
        for title, values in fields.items()
    ]
    for pose, pressure in zip(
        exposure["shown"].values, exposure["pressure"].values, strict=True
    ):
        drawn.append((f"pose {pose + 1}", height, {"marks": {BLACK: pressure > 0}}))
    figure = maps.draw_maps(drawn, 4)
    for panel in figure.axes[: len(fields)]:
        maps.draw_footprints(panel, patches, patch_size_mm, colour=BLUE)
    return figure


@styled
def force_figure(
    contact: xr.Dataset, pressures: pd.DataFrame, *, patch_size_mm: float
) -> Figure:
    """Contact forces at the last step (Fig. 8), and every patch's pressure (Table 1).

    `contact` is the square's; `pressures` is ``patch_pressures.csv`` with the interval of each
    patch, ``low_MPa, high_MPa``.
    """
    figure, (square, bars) = style.panels(2, 2)
    label = "contact force per element (N), square-root scale"
    maps.draw_forces(square, contact, bar=label, ticks=True)
    maps.draw_footprints(square, pressures, patch_size_mm, colour=BLUE)
    displacement = float(contact["displacement"]) * MM_TO_UM
    square.set_title(f"displacement {displacement:.1f} µm", loc="right")
    maps.mark_corner(square)

    places, values = np.arange(len(pressures)), pressures["pressure_MPa"]
    studied = pressures["in_study"]
    bars.bar(places[studied], values[studied], color=BLUE, label="in the study")
    bars.bar(
        places[~studied],
        values[~studied],
        color="none",
        edgecolor=GREY,
        label="left out",
    )
    bars.vlines(
        places, pressures["low_MPa"], pressures["high_MPa"], color=BLACK, linewidth=0.7
    )
    style.name_patches(bars, list(pressures["patch"]))
    bars.set_ylabel("pressure (MPa), 95 % interval")
    bars.set_title("pressure of every patch")
    bars.legend()
    return figure
