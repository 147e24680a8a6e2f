"""What is in a scan or a mesh, in the figures by which one sees that it was read rightly."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import make_surface, spacing_of

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "MESH_SUFFIXES",
    "held_height",
    "inspect_file",
    "mesh_facts",
    "mesh_relief",
    "scan_facts",
    "text_thumbnail",
]

MESH_SUFFIXES = (".stl", ".ply", ".obj")

_MM_TO_UM = 1e3
# Cells along the longest side of a mesh's relief.
_RELIEF_CELLS = 200
# From low to high; unmeasured is another character.
_SHADES, _UNMEASURED = " ░▒▓█", "·"
# One height at more than this share of the points, and at so many times the points of any other,
# was written, not measured: of heights in few steps, each is about as frequent as the next.
_HELD_SHARE, _HELD_TIMES = 1e-3, 10
# As many points tell the shares of a larger scan.
_ENOUGH_POINTS = 1 << 20
# A character is about twice as high as wide.
_ASPECT = 2.0


def inspect_file(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> tuple[dict[str, object], xr.DataArray]:
    """Facts about a scan or a mesh, and its heights to draw.

    Parameters
    ----------
    path : str or Path
        A mesh (STL, PLY, OBJ), else a scan.
    unit : str, optional
        Unit of a file that does not say it; meshes never do: mm by default.
    spacing_um : float, optional
        Spacing of the points of a scan that does not say it (text), or to grid it with.

    Returns
    -------
    facts : dict
        ``unit`` (whether the file says it), then as of `scan_facts` or `mesh_facts`.
    heights : (ny, nx) xarray.DataArray
        mm: the scan without its plane, or the mesh seen along its shortest side.

    Raises
    ------
    InputError
        As `read_scan` and `read_mesh`.
    """
    if Path(path).suffix.lower() in MESH_SUFFIXES:
        mesh = read_mesh(path, unit=unit or "mm")
        said = f"{unit}, as told" if unit else "mm, for lack of another: meshes do not say it"
        return {"unit": said} | mesh_facts(mesh), mesh_relief(mesh)
    spacing_mm = None if spacing_um is None else spacing_um / _MM_TO_UM
    given = {"spacing_mm": spacing_mm, "scatter_spacing_mm": spacing_mm}
    try:
        scan, said = read_scan(path, **given), "in the file"
    except InputError:
        if unit is None:
            raise
        scan, said = read_scan(path, unit=unit, **given), f"{unit}, as told"
    return {"unit": said} | scan_facts(scan), remove_plane(scan)[0]


def scan_facts(scan: xr.DataArray) -> dict[str, object]:
    """Points, spacing, size, unmeasured share, heights, tilt and Sq of a scan (mm) as it was read.

    Sq is the r.m.s. height about the least-squares plane. The file's own texts (instrument,
    objective, ...) come last.
    """
    dy, dx = spacing_of(scan)
    ny, nx = scan.shape
    level, plane = remove_plane(scan)
    own = {name: value for name, value in scan.attrs.items() if name not in ("units", "long_name")}
    return {
        "points_x": nx,
        "points_y": ny,
        "spacing_x_um": dx * _MM_TO_UM,
        "spacing_y_um": dy * _MM_TO_UM,
        "size_x_mm": nx * dx,
        "size_y_mm": ny * dy,
        "unmeasured": float(1 - np.isfinite(scan.values).mean()),
        "lowest_um": float(np.nanmin(scan.values)) * _MM_TO_UM,
        "highest_um": float(np.nanmax(scan.values)) * _MM_TO_UM,
        "tilt_x_mrad": plane.tilt_x_mrad,
        "tilt_y_mrad": plane.tilt_y_mrad,
        "Sq_um": float(np.nanstd(level.values)) * _MM_TO_UM,
        **own,
    }


def held_height(scan: xr.DataArray) -> tuple[float, float] | None:
    """The one height at which so many points of a scan (mm) lie that it was hardly measured.

    Returns
    -------
    (height_um, share) or None
        As of points that were not measured and stand in the file as 0 or -999; the share (0 to 1)
        is of all points. None where there is no such height.
    """
    some = scan.values.ravel()[:: -(-scan.size // _ENOUGH_POINTS)]
    heights, counts = np.unique(some[np.isfinite(some)], return_counts=True)
    if not len(counts):
        return None
    most = int(np.argmax(counts))
    others = np.delete(counts, most).max(initial=0)
    if counts[most] <= max(_HELD_SHARE * some.size, _HELD_TIMES * others):
        return None
    return float(heights[most]) * _MM_TO_UM, float(counts[most] / some.size)


def mesh_facts(mesh: "trimesh.Trimesh") -> dict[str, object]:
    """Vertices, faces, size, mean edge and state of a mesh (mm)."""
    extents = mesh.bounds[1] - mesh.bounds[0]
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        **{f"size_{axis}_mm": float(size) for axis, size in zip("xyz", extents, strict=True)},
        **{
            f"centre_{axis}_mm": float(middle)
            for axis, middle in zip("xyz", mesh.bounds.mean(axis=0), strict=True)
        },
        "mean_edge_mm": float(mesh.edges_unique_length.mean()),
        "bodies": int(mesh.body_count),
        "closed": "yes" if mesh.is_watertight else "no",
    }


def mesh_relief(mesh: "trimesh.Trimesh") -> xr.DataArray:
    """Highest vertices of a mesh, seen along its shortest side, on a coarse grid (mm)."""
    points = np.asarray(mesh.vertices) - mesh.bounds[0]
    across = int(np.argmin(np.ptp(points, axis=0)))
    first, second = (axis for axis in range(3) if axis != across)
    # Cells as wide as edges at least, or the picture is full of holes.
    step = max(np.ptp(points, axis=0).max() / _RELIEF_CELLS, 1.5 * mesh.edges_unique_length.mean())
    columns, rows = ((points[:, axis] / step).astype(int) for axis in (first, second))
    highest = np.full((rows.max() + 1, columns.max() + 1), -np.inf)
    np.maximum.at(highest, (rows, columns), points[:, across])
    highest[np.isinf(highest)] = np.nan
    return make_surface(highest, step)


def text_thumbnail(surface: xr.DataArray, width: int = 64) -> str:
    """A surface in five shades, from low to high, for a terminal; `·` is unmeasured.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
    width : int
        Characters to a line; the number of lines follows from the surface's shape.
    """
    dy, dx = spacing_of(surface)
    ny, nx = surface.shape
    columns = min(width, nx)
    lines = max(1, min(ny, round(columns * ny * dy / (nx * dx) / _ASPECT)))
    rows = np.linspace(0, ny, lines + 1).astype(int)
    steps = np.linspace(0, nx, columns + 1).astype(int)
    known = np.isfinite(surface.values)
    cells = (np.where(known, surface.values, 0.0), known.astype(float))
    sums, counts = (
        np.add.reduceat(np.add.reduceat(cell, rows[:-1], axis=0), steps[:-1], axis=1)
        for cell in cells
    )
    mean = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    # Equal shares of the picture in each shade: one spike does not blank the rest.
    limits = np.nanquantile(mean, np.linspace(0, 1, len(_SHADES) + 1)[1:-1])
    shades = np.array([*_SHADES, _UNMEASURED])
    places = np.where(np.isnan(mean), len(_SHADES), np.searchsorted(limits, mean, side="right"))
    return "\n".join("".join(row) for row in shades[places])
