"""Where to scan: a sheet to print and take to the microscope."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gst.page.figures import maps
from gst.page.figures.style import BLACK, BLUE, GREY, VERMILION, short, styled
from gst.page.figures.tool import FACES, draw_square, draw_stone
from gst.page.viewer import coarsen
from gstlib.macroscale.sampling_sites import EXPOSED
from gstlib.surfaces.footprints import PatchPosition, outline, square_of
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh

__all__ = ["places_figure"]

_PAGE = (7.4, 9.6)  # inches: fits A4 and letter
_HEADS = "place", "x (mm)", "y (mm)", "N/mm", "touched"
_NOTE = (
    "E: most exposed. C: control, touched in no pose (dashed).\n"
    "N/mm: pressure times sliding, all poses, mean of the place.\n"
    "Touched: poses that touch its most often touched point."
)
_X_AND_Y = "x and y: from the reference corner to the middle of a place, along the square's edges"


@styled
def places_figure(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    exposure: xr.Dataset,
    places: pd.DataFrame,
    *,
    size_mm: float,
    patch_size_mm: float,
) -> Figure:
    """The square on the stone and in the face, and the places in the square with their distances.

    `mesh` is the stone, mm; `exposure` has ``exposure, touched`` (y, x) of the face, from
    `gstlib.macroscale.gesture.exposure`; `places` is ``places.csv``.
    """
    figure = Figure(figsize=_PAGE, layout="constrained")
    grid = {
        "height_ratios": [3, 4],
        "width_ratios": [4, 3],
        "left": 0.05,
        "right": 0.99,
    }
    panels = figure.subplots(2, 2, gridspec_kw=grid)
    (stone, face), (square, table) = panels
    view = Frame(np.mean(mesh.bounds, axis=0), frame.x_axis, frame.normal)
    draw_stone(stone, coarsen(mesh, faces=FACES), view)
    draw_square(stone, view, frame, size_mm)
    stone.set_title("the stone, seen along the square's normal")
    touched = exposure.touched.values > 0
    maps.draw_map(
        face, exposure.touched, np.zeros(touched.shape), marks={BLACK: touched}
    )
    corners = outline(PatchPosition(size_mm / 2, size_mm / 2), size_mm)
    face.plot(*corners[[0, 1, 2, 3, 0]].T, color=VERMILION)
    face.plot(*corners[0], "o", color=VERMILION)
    maps.scale_bar(face)
    face.set_title("the face, black if any pose touches it;\nthe square and its corner")
    _draw_places(square, square_of(exposure.exposure, size_mm), places, patch_size_mm)
    _write_table(table, places)
    figure.suptitle(f"Where to scan\n{_X_AND_Y}", x=0.02, ha="left")
    return figure


def _draw_places(
    axes: Axes, exposure: xr.DataArray, places: pd.DataFrame, patch_size_mm: float
) -> None:
    """The exposure of the square, and the places in it: dashed if they are controls."""
    values = exposure.values
    bar = "exposure (N/mm), square-root scale"
    look = {"cmap": maps.FORCE_MAP, "norm": maps.force_norm(values)}
    maps.draw_map(axes, exposure, values, bar=bar, ticks=True, **look)
    outlined = places.rename(columns={"place": "patch"})
    outlined = outlined.assign(rotation_deg=0.0, in_study=places.kind == EXPOSED)
    maps.draw_footprints(axes, outlined, patch_size_mm, colour=BLUE)
    for place in places.itertuples():
        axes.plot(place.x_mm, place.y_mm, "+", color=BLUE, path_effects=maps.OUTLINE)
    maps.mark_corner(axes)


def _write_table(axes: Axes, places: pd.DataFrame) -> None:
    """The places and their distances, beside the map of the square."""
    rows = [
        [
            place.place,
            f"{place.x_mm:.2f}",
            f"{place.y_mm:.2f}",
            short(place.exposure_N_per_mm),
            f"{100 * place.touched:.0f} %",
        ]
        for place in places.itertuples()
    ]
    axes.set_axis_off()
    table = axes.table(
        rows, colLabels=_HEADS, loc="upper left", edges="open", cellLoc="left"
    )
    table.auto_set_font_size(False)
    look = {"fontsize": 6, "color": GREY, "in_layout": False}
    axes.text(0, 0, _NOTE, transform=axes.transAxes, **look)
