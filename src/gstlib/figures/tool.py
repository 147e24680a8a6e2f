"""The whole tool with the pressure on its square: the mesh for the page, and a still picture."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm, to_rgb
from matplotlib.patches import Polygon

from gstlib.figures.maps import FORCE_MAP
from gstlib.figures.style import VERMILION
from gstlib.preprocess.frame import Frame
from gstlib.surface import spacing_of
from gstlib.viewer import coarsen

if TYPE_CHECKING:
    import trimesh

__all__ = ["STONE", "coloured_tool", "draw_tool", "outline_on", "pressure_norm", "tool_view"]

STONE = "#b9b2a6"
# Where the tool is seen from, in the square's axes: aslant, so that its shape shows.
_VIEW = np.array([-0.35, -0.55, 1.0])


def tool_view(mesh: "trimesh.Trimesh", frame: Frame) -> Frame:
    """How the whole tool (mm) is looked at: its middle is that of the picture."""
    axes = np.array([frame.x_axis, frame.y_axis, frame.normal])
    towards = _VIEW @ axes
    view = Frame((0.0, 0.0, 0.0), np.cross(frame.y_axis, towards).tolist(), towards.tolist())
    seen = view.to_frame(mesh.vertices)
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    middle = middle @ np.array([view.x_axis, view.y_axis, view.normal])
    return Frame(middle.tolist(), view.x_axis, view.normal)


def pressure_norm(pressure: xr.DataArray) -> PowerNorm:
    """A square-root scale from 0 to the largest pressure, MPa."""
    return PowerNorm(0.5, vmin=0, vmax=float(pressure.max()) or 1.0)


def coloured_tool(
    mesh: "trimesh.Trimesh", frame: Frame, pressure: xr.DataArray, *, faces: int
) -> tuple["trimesh.Trimesh", np.ndarray]:
    """A mesh of fewer faces, but for the square, whose faces are cut as fine as its grid.

    Parameters
    ----------
    mesh : trimesh.Trimesh
        The tool, mm.
    frame : Frame
        The square's frame.
    pressure : (y, x) xarray.DataArray
        On the grid of the square, MPa.
    faces : int
        About as many faces are left beside the square.

    Returns
    -------
    trimesh.Trimesh, (n, 3) ndarray of uint8
        The mesh, and the colour of each vertex: that of the pressure in the square, else `STONE`.
    """
    import trimesh
    from trimesh.remesh import subdivide_to_size

    if mesh.is_watertight and mesh.volume < 0:  # inside out
        mesh = mesh.copy()
        mesh.invert()
    size, spacing = _size_of(pressure), spacing_of(pressure)
    margin = 3 * float(np.median(mesh.edges_unique_length))
    keep = _over_square(mesh, frame, size, margin)[1]
    mesh = coarsen(mesh, faces=faces, keep=keep if keep.sum() < faces / 2 else None)
    on_square = _over_square(mesh, frame, size, margin)[1][mesh.faces].all(axis=1)
    points, cut = subdivide_to_size(mesh.vertices, mesh.faces[on_square], 1.5 * max(spacing), 30)
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
    shown = pressure_norm(pressure)(pressure.values[row, column])
    colours[is_over] = FORCE_MAP(shown)[:, :3]
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
    # Of an arm of the stone above or below it, the square is the side nearest to its plane.
    nearest = places[over[np.argmin(np.abs(places[over, 2]))], 2]
    return places, is_over & faces_out & (np.abs(places[:, 2] - nearest) < size)


def outline_on(
    mesh: "trimesh.Trimesh", frame: Frame, corners: np.ndarray, size: float
) -> np.ndarray:
    """A closed outline laid on the tool: (n, 3) points in the mesh's coordinates.

    `corners` are (k, 2), in the square's frame; between them a point every twentieth of `size`.
    """
    from scipy.spatial import KDTree

    places, is_over = _over_square(mesh, frame, size, 0.1 * size)
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    along = [
        np.linspace(start, end, max(2, round(20 * np.linalg.norm(end - start) / size)), False)
        for start, end in sides
    ]
    flat = np.concatenate(along)
    _, nearest = KDTree(places[is_over, :2]).query(flat)
    heights = places[is_over, 2][nearest]
    axes = np.array([frame.x_axis, frame.y_axis, frame.normal])
    return np.column_stack([flat, heights]) @ axes + np.array(frame.origin)


def draw_tool(
    axes: Axes, mesh: "trimesh.Trimesh", frame: Frame, pressure: xr.DataArray, *, faces: int = 40000
) -> None:
    """A picture of the tool from `tool_view`, its square outlined."""
    from gstlib.figures.stone import draw_stone  # loads trimesh, which no other figure needs

    whole, colours = coloured_tool(mesh, frame, pressure, faces=faces)
    view = tool_view(whole, frame)
    draw_stone(axes, whole, view, colours=colours)
    size = _size_of(pressure)
    square = size * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    outline = view.to_frame(outline_on(whole, frame, square, size))
    axes.add_patch(Polygon(outline[:, :2], fill=False, edgecolor=VERMILION, lw=1))
