"""What a scan or a mesh contains, file by file: `gst inspect`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.meshes import is_mesh, read_mesh
from gstlib.io.scans import is_scan, read_scan
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh

__all__ = ["files_in", "inspect_file", "scan_facts"]


def files_in(path: Path) -> list[Path]:
    """The scans and meshes in a folder and those in it; a file itself.

    Raises an `InputError` if there is none.
    """
    if not path.is_dir():
        return [path]
    there = sorted(file for file in path.rglob("[!.]*") if file.is_file())
    found = [file for file in there if is_mesh(file) or is_scan(file)]
    if not found:
        raise InputError(
            path, "has no file with the ending of a scan or a mesh", "Name another."
        )
    return found


def inspect_file(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> tuple[dict[str, Any], "xr.DataArray | trimesh.Trimesh"]:
    """Facts about a scan or a mesh, and its content to draw; errors as in their readers.

    `unit` is that of a file that does not state it (meshes: mm, or m for GLB), `spacing_um` that
    of the points of a text. Facts are the ``unit``, and who states it; points, spacing, size and
    heights of a scan, and what it says about its instrument; vertices, faces, size and state of a
    mesh. The content is the scan (y, x) without its plane, or the mesh, both in mm.
    """
    if is_mesh(path):
        mesh = read_mesh(path, unit=unit)
        file_unit = mesh.metadata["file_unit"]
        said = f"{file_unit}, as given" if unit else f"{file_unit}, in the file"
        if unit is None and not mesh.metadata["states_unit"]:
            said = f"not stated: {file_unit} is assumed; give another as --unit"
        return {"unit": said} | _mesh_facts(mesh), mesh
    scan = read_scan(path, unit=unit, spacing_um=spacing_um)
    said = "in the file" if scan.attrs["unit_stated"] == "yes" else f"{unit}, as given"
    return {"unit": said} | scan_facts(scan), remove_plane(scan)[0]


def scan_facts(scan: xr.DataArray) -> dict[str, Any]:
    """Facts about a scan (mm) as it was read; Sq is about the least-squares plane."""
    dy, dx = spacing_of(scan)
    ny, nx = scan.shape
    level, plane = remove_plane(scan)
    not_shown = "units", "long_name", "unit_stated"
    own = {name: value for name, value in scan.attrs.items() if name not in not_shown}
    return {
        "points_x": nx,
        "points_y": ny,
        "spacing_x_um": dx * MM_TO_UM,
        "spacing_y_um": dy * MM_TO_UM,
        "size_x_mm": nx * dx,
        "size_y_mm": ny * dy,
        "unmeasured": float(1 - np.isfinite(scan.values).mean()),
        "lowest_um": float(np.nanmin(scan.values)) * MM_TO_UM,
        "highest_um": float(np.nanmax(scan.values)) * MM_TO_UM,
        "tilt_x_mrad": plane.tilt_x_mrad,
        "tilt_y_mrad": plane.tilt_y_mrad,
        "Sq_um": float(np.nanstd(level.values)) * MM_TO_UM,
        **own,
    }


def _mesh_facts(mesh: "trimesh.Trimesh") -> dict[str, Any]:
    """Vertices, faces, size, mean edge, step of the coordinates and state of a mesh (mm)."""
    facts: dict[str, Any] = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    for axis, low, high in zip("xyz", *mesh.bounds.tolist(), strict=True):
        facts |= {f"size_{axis}_mm": high - low, f"centre_{axis}_mm": (low + high) / 2}
    return facts | {
        "mean_edge_mm": float(mesh.edges_unique_length.mean()),
        "step_um": mesh.metadata["step_mm"] * MM_TO_UM,
        "bodies": int(mesh.body_count),
        "closed": "yes" if mesh.is_watertight else "no",
    }
