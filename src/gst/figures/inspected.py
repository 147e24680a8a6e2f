"""A picture of one measured file: the heights of a scan, or a mesh from three sides."""

from typing import TYPE_CHECKING

import xarray as xr
from matplotlib.figure import Figure

from gst.figures.maps import HEIGHTS, draw_map
from gst.figures.style import panels, styled
from gst.figures.tool import FACES, draw_stone
from gst.viewer import coarsen
from gstlib.surfaces.frames import Frame

if TYPE_CHECKING:
    import trimesh

__all__ = ["inspected_figure"]

# From where a mesh is seen: the directions to the right, and towards the eye.
_VIEWS = {
    "from +z": ((1, 0, 0), (0, 0, 1)),
    "from −y": ((1, 0, 0), (0, -1, 0)),
    "from +x": ((0, 1, 0), (1, 0, 0)),
}


@styled
def inspected_figure(content: "xr.DataArray | trimesh.Trimesh", name: str) -> Figure:
    """The content of a file, as `gst.inspecting.inspect_file` returns it, under the file's name."""
    room = (0.55, 0.25, 0.3, 0.85)
    if isinstance(content, xr.DataArray):
        figure, (axes,) = panels(1, 2, 1.0, room)
        draw_map(axes, content, ticks=True, **HEIGHTS)
        axes.set_title(f"{name}, without its plane")
        return figure
    figure, views = panels(len(_VIEWS), len(_VIEWS))
    mesh = coarsen(content, faces=FACES)
    for axes, (title, directions) in zip(views, _VIEWS.items(), strict=True):
        draw_stone(axes, mesh, Frame(mesh.bounds.mean(axis=0), *directions))
        axes.set_title(f"{name}, {title}")
    return figure
