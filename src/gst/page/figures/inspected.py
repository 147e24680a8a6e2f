"""Pictures of one file: the heights of a scan, or how it is pressed; a mesh from three sides."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from gst.page.figures.maps import (
    FORCE_MAP,
    HEIGHTS,
    PALE,
    draw_map,
    force_norm,
    height_norm,
    scale_bar,
)
from gst.page.figures.microscale import change_colours, detected_change
from gst.page.figures.style import BLUE, VERMILION, panels, styled
from gst.page.figures.tool import FACES, draw_stone
from gst.page.viewer import coarsen
from gstlib.bem.loading import LoadPath
from gstlib.io.instruments import plain_text
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh

__all__ = ["changed_figure", "inspected_figure", "pressed_figure"]

# From where a mesh is seen: the directions to the right, and towards the eye.
_VIEWS = {
    "from +z": ((1, 0, 0), (0, 0, 1)),
    "from −y": ((1, 0, 0), (0, -1, 0)),
    "from +x": ((0, 1, 0), (1, 0, 0)),
}


@styled
def inspected_figure(content: "xr.DataArray | trimesh.Trimesh", name: str) -> Figure:
    """The content of a file, from `gst.check.inspecting.inspect_file`, under the file's name."""
    if isinstance(content, xr.DataArray):
        figure, (axes,) = panels(1, 2)
        draw_map(axes, content, ticks=True, **HEIGHTS)
        axes.set_title(f"{plain_text(name)}, without its plane")
        return figure
    figure, views = panels(len(_VIEWS), len(_VIEWS))
    mesh = coarsen(content, faces=FACES)
    for axes, (title, directions) in zip(views, _VIEWS.items(), strict=True):
        draw_stone(axes, mesh, Frame(mesh.bounds.mean(axis=0), *directions))
        axes.set_title(f"{plain_text(name)}, {title}")
    return figure


@styled
def pressed_figure(height: xr.DataArray, contact: LoadPath, name: str) -> Figure:
    """The contact over the heights, its pressure, and area and displacement along the path."""
    figure, (left, right, area, depth) = panels(4, 2)
    final, table = contact.final, contact.table()
    draw_map(
        left, height, marks={VERMILION: final.contact.values}, ticks=True, **HEIGHTS
    )
    left.set_title(
        f"{plain_text(name)}: contact {final.contact_fraction:.2%} at {final.mean_pressure:.4g} MPa"
    )
    pressure = final.pressure.values
    look = {"cmap": FORCE_MAP, "norm": force_norm(pressure), "ticks": True}
    draw_map(right, height, pressure, bar="pressure (MPa)", **look)
    right.set_title(f"Pressure, at most {pressure.max():.4g} MPa")
    area.plot(table.mean_pressure_MPa, 100 * table.contact_fraction, ".-", color=BLUE)
    area.set(ylabel="real contact area A / Aₙ (%)", title="Area in contact")
    depth.plot(table.mean_pressure_MPa, table.displacement_um, ".-", color=BLUE)
    depth.set(ylabel="far-field displacement (µm)", title="Displacement")
    for axes in (area, depth):
        axes.set(xlabel="mean pressure (MPa)", xlim=(0, None), ylim=(0, None))
    return figure


@styled
def changed_figure(
    t0: xr.DataArray, change: xr.Dataset, names: tuple[str, str]
) -> Figure:
    """Both scans, the second as it lies on the first, and the height that was lost or gained.

    The arguments are the results of `gst.share.change.compare_scans` and the names of the files.
    """
    figure, axes = panels(3, 3)
    heights = HEIGHTS | {"norm": height_norm(t0, change["t1"])}
    for panel, field, name in zip(axes, (t0, change["t1"]), names, strict=False):
        draw_map(panel, field, **heights)
        panel.set_title(plain_text(name))
    scale_bar(axes[0])
    unknown = {PALE: np.isnan(change["change"].values)}
    colours = change_colours(change) | {"bar": "height change (µm), 0 if not detected"}
    draw_map(axes[2], t0, detected_change(change), marks=unknown, **colours)
    limit_um = change.attrs["level_of_detection_um"]
    axes[2].set_title(f"change beyond {limit_um:.3g} µm")
    return figure
