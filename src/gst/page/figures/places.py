"""Where to scan: a sheet to print and take to the microscope."""

import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gst.page.figures import maps, style
from gst.page.figures.style import BLACK, BLUE, GREY, short
from gst.page.figures.tool import draw_square, draw_stone
from gst.page.results import Results
from gstlib.macroscale.sampling_sites import EXPOSED
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import Frame

_NOTE = (
    "E: most exposed. C: control, touched in no pose (dashed).\n"
    "N/mm: pressure times sliding, all poses, mean of the place.\n"
    "Touched: poses that touch its most often touched point."
)
_X_AND_Y = "x and y: from the reference corner to the middle of a place, along the square's edges"


def places_figure(study: Results) -> Figure:
    """The square on the stone and in the face, and its places with their distances."""
    figure, (stone, face, square, table) = style.panels(4, 2)
    mesh, frame = study.tool
    exposure = study.data("exposure", "exposure", "touched")
    places = study.table("places")
    view = Frame(mesh.bounds.mean(axis=0), frame.x_axis, frame.normal)
    draw_stone(stone, mesh, view)
    draw_square(stone, view, frame, study.size_mm)
    stone.set_title("the stone, seen along the square's normal")
    maps.draw_map(face, exposure.touched, marks={BLACK: exposure.touched > 0})
    maps.outline_square(face, study.size_mm)
    maps.scale_bar(face)
    face.set_title("the square in the face, which is black if any pose touches it")
    _draw_places(square, square_of(exposure.exposure, study.size_mm), study)
    _write_table(table, places)
    figure.suptitle(f"Where to scan\n{_X_AND_Y}")
    return figure


def _draw_places(axes: Axes, exposure: xr.DataArray, study: Results) -> None:
    """The exposure of the square, and the places in it: dashed if they are controls."""
    places = study.table("places")
    bar = "exposure (N/mm), square-root scale"
    maps.draw_map(axes, exposure, maps.force_colours(exposure), bar=bar, ticks=True)
    outlined = places.rename(columns={"place": "patch"})
    outlined = outlined.assign(rotation_deg=0.0, in_study=places.kind == EXPOSED)
    maps.draw_footprints(axes, outlined, study.patch_mm, colour=BLUE)
    axes.plot(places.x_mm, places.y_mm, "+", color=BLUE, path_effects=maps.OUTLINE)
    maps.mark_corner(axes)


def _write_table(axes: Axes, places: pd.DataFrame) -> None:
    """The places and their distances, beside the map of the square."""
    columns = {
        "place": places.place,
        "x (mm)": places.x_mm.map("{:.2f}".format),
        "y (mm)": places.y_mm.map("{:.2f}".format),
        "N/mm": places.exposure_N_per_mm.map(short),
        "touched": (100 * places.touched).map("{:.0f} %".format),
    }
    axes.set_axis_off()
    table = axes.table(
        list(zip(*columns.values(), strict=True)),
        colLabels=list(columns),
        edges="open",
        loc="upper left",
        cellLoc="left",
    )
    table.auto_set_font_size(False)
    note = axes.text(0, 0, _NOTE, fontsize=6, color=GREY, transform=axes.transAxes)
    note.set_in_layout(False)
