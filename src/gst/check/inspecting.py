"""The contents of scans and meshes, file by file (`gst inspect`)."""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from gst.share.options import in_options
from gstlib.errors import GstError, InputError
from gstlib.io.meshes import is_mesh, read_mesh
from gstlib.io.scans import is_scan, read_scan
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh


def describe_files(
    paths: Iterable[Path],
    *,
    unit: str | None = None,
    spacing_um: float | None = None,
    pictures: Path | None = None,
) -> bool:
    """Print the facts of files, or of those in folders; whether all of them could be read.

    `pictures` is the folder for a picture of each; the others are as in `inspect_file`.
    """
    all_read = True
    names: set[str] = set()
    for file in (file for path in paths for file in _files_in(path)):
        try:
            facts, content = inspect_file(file, unit=unit, spacing_um=spacing_um)
            if pictures is not None:
                from gst.page.figures.inspected import inspected_figure
                from gst.page.figures.style import save_figure

                facts["picture"] = pictures / f"{_new_name(file, names)}.png"
                save_figure(inspected_figure(content, file.name), facts["picture"])
        except GstError as error:
            all_read = False
            print(f"ERROR: {in_options(str(error))}", file=sys.stderr)
            continue
        width = max(map(len, facts))
        print(file)
        for name, value in facts.items():
            shown = f"{value:.5g}" if isinstance(value, float) else value
            print(f"  {name.ljust(width)}  {shown}")
        print()
    return all_read


def _new_name(file: Path, names: set[str]) -> str:
    """The name of a file, after those of its folders where `names` has it; added to `names`."""
    name = file.name
    for folder in file.absolute().parents:
        if name not in names:
            break
        name = f"{folder.name}_{name}"
    names.add(name)
    return name


def _files_in(path: Path) -> Iterator[Path]:
    """The scans and meshes in a folder and those in it; a file itself.

    Raises an `InputError` if there is none.
    """
    if not path.is_dir():
        yield path
        return
    files = sorted(file for file in path.rglob("[!.]*") if file.is_file())
    readable = [file for file in files if is_mesh(file) or is_scan(file)]
    if not readable:
        problem = "has no file with the ending of a scan or a mesh"
        raise InputError(path, problem, "Name another.")
    yield from readable


def inspect_file(
    path: str | Path, *, unit: str | None = None, spacing_um: float | None = None
) -> tuple[dict[str, Any], "xr.DataArray | trimesh.Trimesh"]:
    """Facts about a scan or a mesh, and its content to draw; errors as in their readers.

    `unit` is that of a file that does not state it (meshes: mm, or m for GLB), `spacing_um` that
    of the points of a text. Facts are the ``unit``, and who states it; points, spacing, size and
    heights of a scan, and what it says about its instrument; vertices, faces, size and state of a
    mesh. The content is the scan (y, x) without its plane, or the mesh, both in mm.
    """
    if not is_mesh(path):
        scan = read_scan(path, unit=unit, spacing_um=spacing_um)
        is_stated = scan.attrs["unit_stated"] == "yes"
        origin = "in the file" if is_stated else f"{unit}, as given"
        return {"unit": origin} | scan_facts(scan), remove_plane(scan)[0]
    mesh = read_mesh(path, unit=unit)
    file_unit = mesh.metadata["file_unit"]
    origin = f"{file_unit}, as given" if unit else f"{file_unit}, in the file"
    if unit is None and not mesh.metadata["states_unit"]:
        origin = f"missing: {file_unit} is assumed (set another with --unit)"
    facts: dict[str, Any] = {"unit": origin}
    facts |= {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    for axis, low, high in zip("xyz", *mesh.bounds.tolist(), strict=True):
        facts |= {f"size_{axis}_mm": high - low, f"centre_{axis}_mm": (low + high) / 2}
    facts |= {
        "mean_edge_mm": float(mesh.edges_unique_length.mean()),
        "step_um": mesh.metadata["step_mm"] * MM_TO_UM,
        "bodies": int(mesh.body_count),
        "closed": "yes" if mesh.is_watertight else "no",
    }
    return facts, mesh


def scan_facts(scan: xr.DataArray) -> dict[str, Any]:
    """Facts about a scan (mm) as it was read; Sq is about the least-squares plane."""
    (dy, dx), (ny, nx) = spacing_of(scan), scan.shape
    level, plane = remove_plane(scan)
    hidden = "units", "long_name", "unit_stated"
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
        **{name: value for name, value in scan.attrs.items() if name not in hidden},
    }
