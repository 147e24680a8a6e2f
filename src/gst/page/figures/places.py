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
from gstlib.surfaces.footprints import Place, outline, square_of
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh

__all__ = ["places_figure"]

_PAGE = (7.4, 9.6)  # inches: fits A4 and letter
_LINE = 0.21  # of the table, inches
_STOPS = {"place": 0.0, "x (mm)": 0.75, "y (mm)": 1.3, "N/mm": 1.85, "touched": 2.45}


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
    figure = Figure(figsize=_PAGE)
    stone, face = _panel(figure, 0.3, 5.75, 2.9), _panel(figure, 4.2, 5.75, 2.9)
    square = _panel(figure, 0.55, 1.1, 4.1)
    view = Frame(np.mean(mesh.bounds, axis=0), frame.x_axis, frame.normal)
    draw_stone(stone, coarsen(mesh, faces=FACES), view)
    draw_square(stone, view, frame, size_mm)
    stone.set_title("the stone, seen along the square's normal")
    touched = exposure.touched.values > 0
    maps.draw_map(face, exposure.touched, np.zeros(touched.shape), marks={BLACK: touched})
    corners = outline(Place(size_mm / 2, size_mm / 2), size_mm)
    face.plot(*corners[[0, 1, 2, 3, 0]].T, color=VERMILION)
    face.plot(*corners[0], "o", color=VERMILION)
    maps.scale_bar(face)
    face.set_title("the face: what any pose touches; the square, and its corner")
    _draw_places(square, exposure.exposure, places, (size_mm, patch_size_mm))
    _write_table(figure, places)
    figure.text(0.3 / _PAGE[0], 0.975, "Where to scan", fontsize=13, va="top")
    said = (
        "x and y: from the reference corner to the middle of a place, along the square's edges"
    )
    figure.text(0.3 / _PAGE[0], 0.949, said, color=GREY, va="top")
    return figure


def _panel(figure: Figure, left: float, bottom: float, side: float) -> Axes:
    """A square panel; lengths in inches."""
    width, height = _PAGE
    return figure.add_axes((left / width, bottom / height, side / width, side / height))


def _draw_places(
    axes: Axes, exposure: xr.DataArray, places: pd.DataFrame, sizes_mm: tuple[float, float]
) -> None:
    """The exposure of the square, and the places in it: dashed if they are controls."""
    values = square_of(exposure, sizes_mm[0])
    norm = maps.force_norm(values.values)
    bar = "exposure (N/mm), square-root scale"
    look = {"cmap": maps.FORCE_MAP, "norm": norm, "bar": bar, "ticks": True}
    maps.draw_map(axes, values, values.values, **look)
    outlined = places.rename(columns={"place": "patch"})
    outlined = outlined.assign(rotation_deg=0.0, in_study=places.kind == EXPOSED)
    maps.draw_footprints(axes, outlined, sizes_mm[1], colour=BLUE)
    for place in places.itertuples():
        axes.plot(place.x_mm, place.y_mm, "+", color=BLUE, path_effects=maps.OUTLINE)
    maps.mark_corner(axes)


def _write_table(figure: Figure, places: pd.DataFrame) -> None:
    """The places and their distances, beside the map of the square."""
    rows = [
        (
            place.place,
            f"{place.x_mm:.2f}",
            f"{place.y_mm:.2f}",
            short(place.exposure_N_per_mm),
            f"{100 * place.touched:.0f} %",
        )
        for place in places.itertuples()
    ]
    left, top = 4.85, 5.1
    for line, cells in enumerate([tuple(_STOPS), *rows]):
        for stop, cell in zip(_STOPS.values(), cells, strict=True):
            at = (left + 0.85 * stop) / _PAGE[0], (top - line * _LINE) / _PAGE[1]
            figure.text(*at, cell, color=BLACK if line else GREY, fontsize=8 if line else 7)
    note = (
        "E: most exposed. C: control, touched in no pose (dashed).\n"
        "N/mm: pressure times sliding, all poses, mean of the place.\n"
        "Touched: poses that touch its most often touched point."
    )
    bottom = top - (len(rows) + 1) * _LINE
    figure.text(left / _PAGE[0], bottom / _PAGE[1], note, fontsize=6, color=GREY, va="top")
