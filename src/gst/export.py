"""A finished study for other programs: `gst export`.

Surfaces for MountainsMap and Gwyddion, the tool for CloudCompare, MeshLab and Blender. Lengths go
into x3p (ISO 25178-72), as doubles in m, NaN where unmeasured. x3p knows no other quantity: of a
pressure the tool has the macroscale's, and the patches' own are in their HDF5 files.
"""

import io
import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import xarray as xr

from gst.chain import check_chain, made_in
from gst.figures.tool import cut_tool
from gstlib.io.files import write_whole
from gstlib.io.meshes import ply_with, read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import places_of
from gstlib.surfaces.frames import FRAME, on_mesh, stored_frame
from gstlib.surfaces.grid import spacing_of

__all__ = ["export_study", "tool_with", "x3p_of"]

# The files of each patch, in the folders of their batches.
_BY_PATCH = {"T0": "surfaces/T0/*/*.h5", "change": "change/*/*.h5", "wear": "wear/*/*.h5"}
# The format asks for a date; that of the export says nothing about a result.
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)


def export_study(results: Path, to: Path) -> list[Path]:
    """Write the maps of every patch, and the tool, into a folder; the files written.

    Raises an `InputError` if the folder holds no finished study, a file has changed since, or its
    mesh is elsewhere.
    """
    check_chain(results)
    written = []
    for name, content in _files(results):
        written.append(to / name)
        write_whole(written[-1], content)
    return written


def _files(results: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each file."""
    made = set(made_in(results))  # other files may be left of other configs
    by_patch: dict[str, dict[str, Path]] = {}
    for stage, pattern in _BY_PATCH.items():
        for file in made & set(results.glob(pattern)):
            patch = file.stem.partition("_")[0]
            by_patch.setdefault(patch, {})[stage] = file
    for patch, stages in sorted(by_patch.items()):
        for name, field in _maps(stages):
            title = f"patch {patch}: {field.attrs['long_name']}"
            yield f"{patch}_{name}.x3p", x3p_of(field, title)
    yield "tool.ply", _tool(results, made)


def _maps(files: Mapping[str, Path]) -> Iterator[tuple[str, xr.DataArray]]:
    """The maps of a patch that the study has, on the grid of T0, by the ends of their names."""
    before = read_dataset(files["T0"], only=["height", "filled"])
    # what was filled from around it was not measured
    yield "T0", before.height.where(~before.filled)
    if change := files.get("change"):
        found = read_dataset(change, only=["t1", "change"])
        if found.attrs["registration_found"]:
            yield "T1", found.t1
            loss = -found.change
            yield "loss", loss.assign_attrs(units="mm", long_name="measured height loss")
    if wear := files.get("wear"):
        for depth in read_dataset(wear, only=["depth"]).depth:
            yield f"predicted_{depth.model.item()}", depth


def x3p_of(heights: xr.DataArray, title: str) -> bytes:
    """An x3p file of a map of lengths (y, x) in mm, NaN where unmeasured."""
    from surfalize import Surface
    from surfalize.file.x3p import write_x3p

    dy, dx = spacing_of(heights)
    content, surface = io.BytesIO(), Surface(heights.values * 1e3, dx * 1e3, dy * 1e3)
    surface.metadata["timestamp"] = _NO_DATE
    write_x3p(content, surface, comment=title)
    return content.getvalue()


def _tool(results: Path, made: set[Path]) -> bytes:
    """The tool as PLY, with pressure, patches and, of a gesture, exposure at its vertices."""
    config = json.loads((results / "provenance.json").read_text(encoding="utf-8"))["config"]
    specimen = {"mesh": results / "specimen/mesh.stl", "mesh_unit": "mm"}
    inputs: dict[str, Any] = config["inputs"] or specimen
    grid = read_dataset(results / "macroscale/contact.h5", only=["pressure"]).pressure
    fields = {"pressure_MPa": grid}
    exposure = results / "gesture/exposure.h5"
    if exposure in made:
        fields["exposure_N_per_mm"] = read_dataset(exposure, only=["exposure"]).exposure
    patches = results / "tables/patch_pressures.csv"
    if patches in made:
        half = config["scans"]["size_mm"] / 2
        row = xr.zeros_like(grid)
        for number, place in enumerate(places_of(read_table(patches)).values(), start=1):
            v, u = place.seen(grid.y, grid.x)
            inside = (abs(v) <= half) & (abs(u) <= half)
            row = row.where(~inside.transpose(*row.dims), number)
        fields["patch"] = row
    face = results / "macroscale/surface.h5"
    return tool_with(fields, Path(inputs["mesh"]), inputs["mesh_unit"], face)


def tool_with(
    fields: Mapping[str, xr.DataArray], mesh: Path, mesh_unit: str, face: Path
) -> bytes:
    """A mesh as PLY in its own coordinates, cut as fine as the fields (y, x) of its use-face.

    `face` is the file with the frame of its square; the fields are 0 beyond the face.
    """
    stone = read_mesh(mesh, unit=mesh_unit)
    frame = stored_frame(read_dataset(face, only=FRAME))
    first = next(iter(fields.values()))
    edge_mm = 1.5 * max(spacing_of(first))
    cut = cut_tool(stone, frame, first, edge_mm=edge_mm, faces=len(stone.faces))
    values = {name: on_mesh(field, cut, frame) for name, field in fields.items()}
    return ply_with(cut, values, unit=mesh_unit)
