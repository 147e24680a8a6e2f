"""The whole tool, in views along given directions: its square, and the pressure on it.

A view is a `Frame`: x to the right, y up, the normal towards the eye, as in the maps.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from gst.figures import maps, style
from gst.figures.macroscale import draw_places
from gst.figures.style import STONE, VERMILION, styled
from gst.viewer import coarsen
from gstlib.geometry import Frame
from gstlib.surface import spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = ["check_figure", "coloured_tool", "draw_square", "draw_stone", "draw_tool"]
__all__ += ["outline_on", "tool_view"]

# Direction from which the tool is seen, in the square's axes: oblique, to show its shape.
_VIEW = np.array([-0.35, -0.55, 1.0])
_FACES = 60_000  # each is a pixel or two: more would not be seen; a page takes 24 bytes of each
_LIGHT = np.array([-1.0, 1.0, 1.4]) / 2  # from the upper left
_PANEL = (3.6, 3.6)
# Corners of a square of side 1, in order.
_UNIT = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def tool_view(mesh: "trimesh.Trimesh", frame: Frame) -> Frame:
    """The view of the whole tool (mm), with its middle in the middle of the picture."""
    towards = _VIEW @ frame.axes
    view = Frame((0.0, 0.0, 0.0), np.cross(frame.axes[1], towards), towards)
    seen = view.to_frame(mesh.vertices)
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2 @ view.axes
    return Frame(middle, view.x_axis, view.normal)


def coloured_tool(
    mesh: "trimesh.Trimesh", frame: Frame, pressure: xr.DataArray, *, faces: int = _FACES
) -> tuple["trimesh.Trimesh", np.ndarray]:
    """A mesh with fewer faces, except in the square, whose faces are cut as fine as its grid.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The tool, mm.
    frame : Frame
        The square's frame.
    pressure : (y, x) xarray.DataArray
        On the grid of the square, MPa.
    faces : int
        About this many faces remain outside the square.

    Returns
    -------
    trimesh.Trimesh, (n, 3) ndarray of uint8
        The mesh, and the colour of each vertex: that of the pressure in the square, else `STONE`.
    """
    import trimesh
    from trimesh.remesh import subdivide_to_size

    size, spacing = _size_of(pressure), spacing_of(pressure)
    margin = 3 * float(np.median(mesh.edges_unique_length))
    keep = _over_square(mesh, frame, size, margin)[1]
    mesh = coarsen(mesh, faces=faces, keep=keep if keep.sum() < faces / 2 else None)
    on_square = _over_square(mesh, frame, size, margin)[1][mesh.faces].all(axis=1)
    points, cut = subdivide_to_size(
        mesh.vertices, mesh.faces[on_square], 1.5 * max(spacing), 30
    )
    triangles = [mesh.faces[~on_square], cut + len(mesh.vertices)]
    whole = trimesh.Trimesh(
        np.concatenate([mesh.vertices, points]), np.concatenate(triangles), process=False
    )
    whole.merge_vertices()
    places, is_over = _over_square(whole, frame, size, 0.0)
    colours = np.tile(np.array(to_rgb(STONE)), (len(whole.vertices), 1))
    row, column = (
        np.clip((places[is_over, axis] / step).astype(int), 0, count - 1)
        for axis, step, count in zip((1, 0), spacing, pressure.shape, strict=True)
    )
    shown = maps.force_norm(pressure.values)(pressure.values[row, column])
    colours[is_over] = maps.FORCE_MAP(shown)[:, :3]
    return whole, np.round(255 * colours).astype(np.uint8)


def _size_of(pressure: xr.DataArray) -> float:
    return float(pressure.x[-1] + pressure.x[0])


def _over_square(
    mesh: "trimesh.Trimesh", frame: Frame, size: float, margin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in the square's frame, and which of them lie over the square on its side."""
    places = frame.to_frame(mesh.vertices)
    faces_out = mesh.vertex_normals @ np.array(frame.normal) > 0
    is_over = ((places[:, :2] >= -margin) & (places[:, :2] <= size + margin)).all(axis=1)
    over = np.flatnonzero(is_over & faces_out)
    # If an arm of the stone lies above or below, the square is on the side nearest its plane.
    nearest = places[over[np.argmin(np.abs(places[over, 2]))], 2]
    return places, is_over & faces_out & (np.abs(places[:, 2] - nearest) < size)


def outline_on(
    mesh: "trimesh.Trimesh", frame: Frame, corners: np.ndarray, size: float
) -> np.ndarray:
    """A closed outline laid on the tool: (n, 3) points in the mesh's coordinates.

    `corners` are (k, 2), in the square's frame; points between them are a twentieth of `size`
    apart.
    """
    places, is_over = _over_square(mesh, frame, size, 0.1 * size)
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    along = [
        np.linspace(start, end, max(2, round(20 * np.linalg.norm(end - start) / size)), False)
        for start, end in sides
    ]
    flat = np.concatenate(along)
    _, nearest = scipy.spatial.KDTree(places[is_over, :2]).query(flat)
    heights = places[is_over, 2][nearest]
    return np.column_stack([flat, heights]) @ frame.axes + np.array(frame.origin)


def draw_stone(
    axes: Axes, mesh: "trimesh.Trimesh", view: Frame, *, colours: np.ndarray | None = None
) -> None:
    """Draw a stone as seen from afar, shaded, with a scale bar.

    `mesh` is the stone (mm), coarse enough to draw: see `coarsen`. The normal of the `view` points
    to the eye; its origin (mm) lies in the middle of the picture. `colours` (n, 3), uint8, are
    those of the vertices.
    """
    corners = view.to_frame(mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    # Normals of the surface around a face: those of slivers are arbitrary.
    normals = mesh.vertex_normals[mesh.faces].mean(axis=1) @ view.axes.T
    front = np.flatnonzero(normals[:, 2] > 0)
    # Painted from the farthest to the nearest.
    front = front[np.argsort(corners[front, :, 2].mean(axis=1))]
    paint = np.array(to_rgb(STONE))
    if colours is not None:
        paint = colours[mesh.faces[front]].mean(axis=1) / 255
    shade = 0.35 + 0.75 * (normals[front] @ _LIGHT).clip(0)
    tone = (paint * shade[:, np.newaxis]).clip(0, 1)
    faces = PolyCollection(corners[front][:, :, :2], facecolors=tone, edgecolors=tone)
    faces.set(linewidths=0.3, rasterized=True)
    axes.add_collection(faces)
    reach = 1.1 * float(np.linalg.norm(corners[..., :2], axis=-1).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    maps.scale_bar(axes)


def draw_square(
    axes: Axes, view: Frame, frame: Frame, size: float, *, names: Sequence[str] = ("x", "y")
) -> None:
    """Outline the square of a side (mm) in a view, with the names of its axes at their ends."""
    corners = view.to_frame(frame.origin + size * _UNIT @ frame.axes[:2])[:, :2]
    look = {"path_effects": maps.OUTLINE, "fontsize": 8, "ha": "center", "va": "center"}
    axes.add_patch(Polygon(corners, fill=False, edgecolor=VERMILION, lw=1.2))
    for corner, name in zip(corners[1::2], names, strict=False):
        axes.text(*(corners[0] + 1.35 * (corner - corners[0])), name, **look)


def draw_tool(
    axes: Axes, mesh: "trimesh.Trimesh", frame: Frame, pressure: xr.DataArray
) -> None:
    """A picture of the tool from `tool_view`, its square coloured by pressure and outlined."""
    whole, colours = coloured_tool(mesh, frame, pressure)
    view = tool_view(whole, frame)
    draw_stone(axes, whole, view, colours=colours)
    draw_square(axes, view, frame, _size_of(pressure), names=())


@styled
def check_figure(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    height: xr.DataArray | None,
    patches: pd.DataFrame,
    *,
    size_mm: float,
    patch_size_mm: float,
) -> Figure:
    """Where the square lies on the stone, in two views, and where the patches lie in the square.

    `mesh` is the stone (mm), `frame` and `size_mm` are those of the square; the others as in
    `gst.figures.macroscale.input_figure`. Without a height the square is left out.
    """
    figure, panels = style.panels(2 + (height is not None), 3, _PANEL, (0.55, 0.25, 0.3, 0.85))
    mesh = coarsen(mesh, faces=_FACES)
    views = {
        "along the square's normal": frame.axes[2],
        "45° from it": frame.axes[1:].sum(axis=0),
    }
    for axes, (name, towards) in zip(panels, views.items(), strict=False):
        view = Frame(mesh.bounds.mean(axis=0), frame.x_axis, towards)
        draw_stone(axes, mesh, view)
        draw_square(axes, view, frame, size_mm)
        axes.set_title(name)
    if height is not None:
        draw_places(panels[2], height, patches, patch_size_mm)
    return figure
