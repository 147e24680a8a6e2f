"""Pictures of one file: the heights of a scan, or how it is pressed; a mesh from three sides."""

from typing import TYPE_CHECKING

import xarray as xr
from matplotlib.figure import Figure

from gst.page.figures import maps
from gst.page.figures.microscale import change_maps
from gst.page.figures.style import BLUE, VERMILION, panels, styled
from gst.page.figures.tool import draw_stone
from gstlib.bem.loading import LoadPath
from gstlib.io.instruments import plain_text
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh

# From where a mesh is seen: the directions to the right, and towards the eye.
_VIEWS = {
    "from +z": ((1, 0, 0), (0, 0, 1)),
    "from −y": ((1, 0, 0), (0, -1, 0)),
    "from +x": ((0, 1, 0), (1, 0, 0)),
}


@styled
def inspected_figure(content: "xr.DataArray | trimesh.Trimesh", name: str) -> Figure:
    """The content of a file, from `gst.check.inspecting.inspect_file`, under the file's name."""
    name = plain_text(name)
    if isinstance(content, xr.DataArray):
        figure, (axes,) = panels(1, 2)
        maps.draw_heights(axes, content)
        axes.set_title(f"{name}, without its plane")
        return figure
    figure, views = panels(len(_VIEWS), len(_VIEWS))
    middle = content.bounds.mean(axis=0)
    for axes, (title, directions) in zip(views, _VIEWS.items(), strict=True):
        draw_stone(axes, content, Frame(middle, *directions))
        axes.set_title(f"{name}, {title}")
    return figure


@styled
def pressed_figure(height: xr.DataArray, contact: LoadPath, name: str) -> Figure:
    """The contact over the heights, its pressure, and area and displacement along the path."""
    figure, (touching, pressed, *curves) = panels(4, 2)
    final, table = contact.final, contact.table()
    pressure = final.pressure
    maps.draw_heights(touching, height, marks={VERMILION: final.contact})
    share = f"{final.contact_fraction:.2%} at {final.mean_pressure:.4g} MPa"
    touching.set_title(f"{plain_text(name)}: contact {share}")
    colours = maps.force_colours(pressure)
    maps.draw_map(pressed, pressure, colours, bar="pressure (MPa)", ticks=True)
    pressed.set_title(f"Pressure, at most {pressure.max():.4g} MPa")
    labels = {
        "Area in contact": "real contact area A / Aₙ (%)",
        "Displacement": "far-field displacement (µm)",
    }
    columns = 100 * table.contact_fraction, table.displacement_um
    for axes, column, (title, y) in zip(curves, columns, labels.items(), strict=True):
        axes.plot(table.mean_pressure_MPa, column, ".-", color=BLUE)
        axes.set(title=title, xlabel="mean pressure (MPa)", ylabel=y)
        axes.set(xlim=(0, None), ylim=(0, None))
    return figure


@styled
def changed_figure(
    t0: xr.DataArray, change: xr.Dataset, names: tuple[str, str]
) -> Figure:
    """Both scans, the second as it lies on the first, and the height that was lost or gained.

    The arguments are the results of `gst.share.change.compare_scans` and the names of the files.
    """
    return maps.draw_maps(change_maps(t0, change, list(map(plain_text, names))), 3)
