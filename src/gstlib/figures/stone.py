"""The whole tool, in views along given directions: where the square lies on it.

A view is a `Frame`: x to the right, y up, the normal towards the eye, as in the maps.
"""

import numpy as np
import pandas as pd
import trimesh
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from gstlib.figures import maps, style
from gstlib.figures.style import BLACK, VERMILION, styled
from gstlib.preprocess.frame import Frame, principal_axes
from gstlib.preprocess.gridding import orientation
from gstlib.viewer import coarsen

__all__ = ["check_figure", "draw_square", "draw_stone", "stone_figure"]

_STONE = "#c9c2b6"
_FACES = 60_000  # each is a pixel or two: more would not be seen
_LIGHT = np.array([-1.0, 1.0, 1.4]) / 2  # from the upper left
_PANEL, _ROOM = (3.6, 3.6), (0.1, 0.1, 0.3, 0.1)


def draw_stone(
    axes: Axes, mesh: trimesh.Trimesh, view: Frame, *, colours: np.ndarray | None = None
) -> None:
    """Draw a stone as it is seen in parallel light from the eye, shaded, with a scale bar.

    Parameters
    ----------
    axes : matplotlib Axes
    mesh : trimesh.Trimesh
        The stone (mm), coarse enough to be drawn: see `coarsen`.
    view : Frame
        Its normal looks at the eye, its origin (mm) lies in the middle of the picture.
    colours : (n, 3) ndarray of uint8, optional
        Of the vertices.
    """
    corners = view.to_frame(mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    # Of the surface around a face: those of slivers are anything.
    normals = (
        mesh.vertex_normals[mesh.faces].mean(axis=1)
        @ np.array([view.x_axis, view.y_axis, view.normal]).T
    )
    normals *= orientation(mesh)
    front = np.flatnonzero(normals[:, 2] > 0)
    # Painted from the farthest to the nearest.
    front = front[np.argsort(corners[front, :, 2].mean(axis=1))]
    paint = (
        np.array(to_rgb(_STONE)) if colours is None else colours[mesh.faces[front]].mean(1) / 255
    )
    shade = 0.35 + 0.75 * (normals[front] @ _LIGHT).clip(0)
    tone = (paint * shade[:, np.newaxis]).clip(0, 1)
    faces = PolyCollection(corners[front][:, :, :2], facecolors=tone, edgecolors=tone)
    faces.set(linewidths=0.3, rasterized=True)
    axes.add_collection(faces)
    reach = 1.1 * float(np.linalg.norm(corners[..., :2], axis=-1).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    maps.scale_bar(axes)


def draw_square(axes: Axes, mesh: trimesh.Trimesh, view: Frame, frame: Frame, size: float) -> bool:
    """Outline the square of a side (mm) in a view: dashed where the stone lies before it.

    Returns
    -------
    bool
        Whether it is in sight.
    """
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]]) * size
    *outline, middle = view.to_frame(
        frame.origin + corners @ np.array([frame.x_axis, frame.y_axis])
    )
    points = view.to_frame(mesh.vertices)
    near = np.linalg.norm((points - middle)[:, :2], axis=1) < size / 4
    seen = not near.any() or bool(points[near, 2].max() < middle[2] + size / 2)
    ends = np.array([*outline, outline[0]])
    look = {"color": VERMILION, "lw": 1.2, "path_effects": maps.OUTLINE}
    axes.plot(*ends[:, :2].T, "-" if seen else "--", **look)
    axes.plot(*ends[0, :2], "o", ms=4, color=BLACK)
    look = {"fontsize": 8, "ha": "center", "va": "center", "path_effects": maps.OUTLINE}
    for corner, name in ((ends[1], "x"), (ends[3], "y")):
        axes.text(*(ends[0] + 1.35 * (corner - ends[0]))[:2], name, **look)
    return seen


@styled
def stone_figure(mesh: trimesh.Trimesh, *, title: str, colours: np.ndarray | None = None) -> Figure:
    """Both sides of a stone (mm), seen along its shortest axis, the longest one upright.

    `colours` are those of the vertices, as in `draw_stone`, for a mesh that `coarsen` has made.
    """
    mesh = mesh if colours is not None else coarsen(mesh, faces=_FACES)
    longest, _, shortest = principal_axes(mesh)
    figure, panels = style.panels(2, 2, _PANEL, _ROOM)
    for axes, towards, name in zip(
        panels, (shortest, -shortest), (title, "other side"), strict=True
    ):
        view = Frame(
            mesh.bounds.mean(axis=0), np.cross(longest, towards).tolist(), towards.tolist()
        )
        draw_stone(axes, mesh, view, colours=colours)
        is_drawn = len(axes.collections[0].get_paths()) > 0
        axes.set_title(name if is_drawn else f"{name}: the mesh has none")
    return figure


@styled
def check_figure(
    mesh: trimesh.Trimesh,
    frame: Frame,
    height: xr.DataArray | None,
    patches: pd.DataFrame,
    *,
    size_mm: float,
    patch_size_mm: float,
) -> Figure:
    """Where the square lies on the stone, in two views, and where the patches lie in the square.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The stone, mm.
    frame : Frame
        Of the square.
    height, patches, patch_size_mm
        As of `input_figure`; without a height the square is left out.
    size_mm : float
        Side of the square.
    """
    figure, panels = style.panels(2 + (height is not None), 3, _PANEL, (0.55, 0.25, 0.3, 0.85))
    mesh = coarsen(mesh, faces=_FACES)
    middle = mesh.bounds.mean(axis=0)
    slanted = np.add(frame.normal, frame.y_axis).tolist()
    for axes, towards, name in zip(
        panels, (frame.normal, slanted), ("along the square's normal", "45° from it"), strict=False
    ):
        view = Frame(middle, frame.x_axis, towards)
        draw_stone(axes, mesh, view)
        seen = draw_square(axes, mesh, view, frame, size_mm)
        axes.set_title(name + ("" if seen else ": the stone hides the square"))
    if height is not None:
        maps.draw_heights(panels[2], height)
        maps.draw_footprints(panels[2], patches, patch_size_mm, colour=BLACK)
        maps.mark_corner(panels[2])
        panels[2].set_title("the square", loc="right")
    return figure
