"""The whole tool, in views along given directions: its square, and the pressure on it.

A view is a `Frame`: x to the right, y up, the normal towards the eye, as in the maps.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import shapely
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from gst.page.figures import maps, style
from gst.page.figures.macroscale import draw_places
from gst.page.figures.style import STONE, VERMILION, styled
from gst.page.viewer import coarsen
from gstlib.surfaces.frames import Frame, on_mesh, over_face
from gstlib.surfaces.grid import MM_TO_UM, make_surface, spacing_of

if TYPE_CHECKING:
    import trimesh

# Direction from which the tool is seen, in the square's axes: oblique, to show its shape.
_VIEW = np.array([-0.35, -0.55, 1.0])
FACES = 60_000  # each is a pixel or two: more would not be seen; a page takes 24 bytes of each
_LIGHT = np.array([-1.0, 1.0, 1.4]) / 2  # from the upper left
# Edges over a wider face are no shorter than this share of it.
_ELEMENTS = 100
_STONE_RGB = np.array(list(bytes.fromhex(STONE[1:])))


def tool_view(mesh: "trimesh.Trimesh", frame: Frame) -> Frame:
    """The view of the whole tool (mm), with its middle in the middle of the picture."""
    towards = _VIEW @ frame.axes
    view = Frame((0.0, 0.0, 0.0), np.cross(frame.axes[1], towards), towards)
    seen = view.to_frame(mesh.vertices)
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    return Frame(middle @ view.axes, view.x_axis, view.normal)


def cut_tool(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    field: xr.DataArray,
    *,
    edge_mm: float,
    faces: int,
) -> "trimesh.Trimesh":
    """A mesh with at most about so many faces, except over a field, where its edges are short.

    `frame` is the square's, `field` (y, x) lies on its grid, or on that of the face around it, and
    `edge_mm` is the longest edge there.
    """
    import trimesh
    from trimesh.remesh import subdivide_to_size

    margin = 3 * float(np.median(mesh.edges_unique_length))
    _, keep = over_face(mesh, frame, field, margin)
    mesh = coarsen(mesh, faces=faces, keep=keep if keep.sum() < faces / 2 else None)
    _, is_over = over_face(mesh, frame, field, margin)
    on_face = is_over[mesh.faces].all(axis=1)
    points, cut = subdivide_to_size(mesh.vertices, mesh.faces[on_face], edge_mm, 30)
    vertices = np.concatenate([mesh.vertices, points])
    triangles = np.concatenate([mesh.faces[~on_face], cut + len(mesh.vertices)])
    whole = trimesh.Trimesh(vertices, triangles, process=False)
    whole.merge_vertices()
    return whole


def coloured_tool(
    mesh: "trimesh.Trimesh", frame: Frame, *fields: xr.DataArray
) -> tuple[Any, ...]:
    """A mesh with fewer faces, except over the fields, whose faces are cut as fine as their grid.

    `mesh` is the tool, mm, and `frame` the square's; the `fields` (y, x) are pressures, exposures
    and the like, all on the grid of the square, or of the face around it. Behind the mesh come the
    colours of its vertices by each field, (n, 3), uint8; `STONE` elsewhere, and where it is NaN.
    """
    first, element = fields[0], max(spacing_of(fields[0]))
    edge_mm = element * max(1.5, len(first.x) / _ELEMENTS)
    whole = cut_tool(mesh, frame, first, edge_mm=edge_mm, faces=FACES)
    # the highest within an edge: none is lost
    reach = round(edge_mm / element / 1.5)
    colours = []
    for field in fields:
        known = field.fillna(0.0).values
        highest = field.copy(data=scipy.ndimage.maximum_filter(known, reach))
        numbers = on_mesh(highest, whole, frame)
        shown = maps.force_colours(field).to_rgba(numbers, bytes=True)[:, :3]
        shown[on_mesh(field.notnull(), whole, frame) == 0] = _STONE_RGB
        colours.append(shown)
    return whole, *colours


def outline_on(
    mesh: "trimesh.Trimesh", frame: Frame, corners: np.ndarray, size: float
) -> np.ndarray:
    """A closed outline laid on the tool: (n, 3) points in the mesh's coordinates.

    `corners` are (k, 2), in the square's frame; points between them are a twentieth of `size`
    apart.
    """
    square = make_surface(np.zeros((2, 2)), size / 2)
    places, is_over = over_face(mesh, frame, square, 0.1 * size)
    height_at = scipy.interpolate.NearestNDInterpolator(
        places[is_over, :2], places[is_over, 2]
    )
    ring = shapely.LinearRing(corners).segmentize(size / 20)
    flat = shapely.get_coordinates(ring)[:-1]
    points = np.column_stack([flat, height_at(flat)])
    return points @ frame.axes + np.array(frame.origin)


def draw_stone(
    axes: Axes, mesh: "trimesh.Trimesh", view: Frame, colours: np.ndarray | None = None
) -> None:
    """Draw a stone as seen from afar, shaded, with a scale bar.

    `mesh` is the stone (mm). The normal of the `view` points to the eye; its origin (mm) lies in
    the middle of the picture. `colours` (n, 3), uint8, are those of the vertices.
    """
    if colours is None:
        mesh = coarsen(mesh, faces=FACES)
        colours = np.full((len(mesh.vertices), 3), _STONE_RGB)
    corners = view.to_frame(mesh.triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    # Normals of the surface around a face: those of slivers are arbitrary.
    normals = mesh.vertex_normals[mesh.faces].mean(axis=1) @ view.axes.T
    front = np.flatnonzero(normals[:, 2] > 0)
    # Painted from the farthest to the nearest.
    front = front[np.argsort(corners[front, :, 2].mean(axis=1))]
    paint = colours[mesh.faces[front]].mean(axis=1) / 255
    shade = 0.35 + 0.75 * (normals[front] @ _LIGHT).clip(0)
    tone = (paint * shade[:, np.newaxis]).clip(0, 1)
    flat = corners[..., :2]
    faces = PolyCollection(
        flat[front], facecolors=tone, edgecolors=tone, linewidths=0.3, rasterized=True
    )
    axes.add_collection(faces)
    reach = 1.1 * float(np.linalg.norm(flat, axis=-1).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    maps.scale_bar(axes)


def draw_square(
    axes: Axes, view: Frame, frame: Frame, size: float, *, names: Sequence[str] = "xy"
) -> None:
    """Outline the square of a side (mm) in a view, with the names of its axes at their ends."""
    square = size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = view.to_frame(frame.origin + square @ frame.axes[:2])[:, :2]
    axes.add_patch(Polygon(corners, fill=False, edgecolor=VERMILION, lw=1.2))
    for name, corner in zip(names, corners[1::2], strict=False):
        x, y = corners[0] + 1.35 * (corner - corners[0])
        axes.text(x, y, name, ha="center", va="center", path_effects=maps.OUTLINE)


def draw_tool(
    axes: Axes, mesh: "trimesh.Trimesh", frame: Frame, pressure: xr.DataArray
) -> None:
    """A picture of the tool from `tool_view`, its square coloured by pressure and outlined."""
    whole, colours = coloured_tool(mesh, frame, pressure)
    view = tool_view(whole, frame)
    draw_stone(axes, whole, view, colours)
    draw_square(axes, view, frame, float(pressure.x[-1] + pressure.x[0]), names="")


class PressedFace(NamedTuple):
    """The face, and how the active tool is pressed on it."""

    face: xr.Dataset  # ``height`` and ``counterface`` (y, x), mm
    pushed: np.ndarray  # (n, 2): points (y, x), mm, through which the tool is pushed
    interlayer_um: float | None = None  # thickness of what is between


@styled
def check_figure(
    mesh: "trimesh.Trimesh",
    frame: Frame,
    height: xr.DataArray | None,
    patches: pd.DataFrame,
    *,
    size_mm: float,
    patch_size_mm: float,
    pressed: PressedFace | None = None,
) -> Figure:
    """Where the square lies on the stone, in two views, and where the patches lie in the square.

    `mesh` is the stone (mm), `frame` and `size_mm` are those of the square; the others as in
    `gst.page.figures.macroscale.draw_places`. Without a height the square is left out. What is
    `pressed` gives a panel with the gap between the tools.
    """
    count = 2 + (height is not None) + (pressed is not None)
    figure, panels = style.panels(count, 2)
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
    if pressed is not None:
        _draw_gap(panels[-1], pressed, size_mm)
    return figure


def _draw_gap(axes: Axes, pressed: PressedFace, size_mm: float) -> None:
    """The gap to the active tool, the nearer the brighter, and where it is pushed."""
    # both are positive towards each other
    nearness = pressed.face.height + pressed.face.counterface
    gap = (nearness.max() - nearness) * MM_TO_UM
    near = maps.height_colours(gap, cmap=maps.HEIGHT_MAP.reversed())
    maps.draw_map(axes, gap, near, bar="gap to the active tool (µm)", ticks=True)
    maps.outline_square(axes, size_mm)
    y, x = pressed.pushed.T
    axes.plot(x, y, "+", color=VERMILION, markersize=4)
    thickness_um = pressed.interlayer_um
    between = f", interlayer of {thickness_um:g} µm" if thickness_um else ""
    axes.set_title(f"the active tool{between} (+: where it is pushed)")
