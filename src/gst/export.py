"""A finished study for other programs: `gst export`.

Surfaces for MountainsMap and Gwyddion, the tool for CloudCompare, MeshLab and Blender. Lengths go
into x3p (ISO 25178-72), as doubles in m, NaN where unmeasured. x3p knows no other quantity;
pressure goes into Digital Surf's `.sur`, which states any unit. surfalize knows both formats, but
writes `.sur` in µm only and moves 0 by what float32 loses, so its header is filled in here.
"""

import io
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gst.chain import check_chain, made_in
from gst.figures.tool import cut_tool
from gstlib.errors import InputError
from gstlib.geometry import FRAME, on_mesh, rotated, stored_frame
from gstlib.io.files import write_whole
from gstlib.io.meshes import ply_with, read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surface import spacing_of

__all__ = ["export_study", "sur_of", "tool_with", "x3p_of"]

# Whole numbers of 32 bits stand for the values of a .sur; these leave room.
_LARGEST_STEP = 1 << 30
_SURFACE = 2  # kind of a .sur: one map
# Both formats ask for a date; that of the export says nothing about a result.
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)


def export_study(results: Path, to: Path) -> list[Path]:
    """Write the maps of every patch, and the tool, into a folder; the files written.

    Raises
    ------
    InputError
        The folder holds no finished study, a file has changed since, or its mesh is elsewhere.
    """
    check_chain(results)
    made = set(made_in(results))  # other files may be left of other configs
    written = []
    for file in sorted(made & set(results.glob("surfaces/*_T0.h5"))):
        patch = file.stem.removesuffix("_T0")
        for name, field in _maps(results, patch, made):
            is_length = field.attrs["units"] == "mm"
            written.append(to / f"{patch}_{name}.{'x3p' if is_length else 'sur'}")
            title = f"patch {patch}: {field.attrs['long_name']}"
            write_whole(written[-1], (x3p_of if is_length else sur_of)(field, title))
    written.append(to / "tool.ply")
    write_whole(written[-1], _tool(results, made))
    return written


def _maps(results: Path, patch: str, made: set[Path]) -> Iterator[tuple[str, xr.DataArray]]:
    """The maps of a patch that the study has, on the grid of T0, by the ends of their names."""
    before = read_dataset(results / f"surfaces/{patch}_T0.h5", only=["height", "filled"])
    # what was filled from around it was not measured
    yield "T0", before.height.where(~before.filled)
    change = results / f"registered/{patch}.h5"
    if change in made:
        found = read_dataset(change, only=["t1", "change"])
        if found.attrs["registration_found"]:
            yield "T1", found.t1
            loss = -found.change
            yield "loss", loss.assign_attrs(units="mm", long_name="measured height loss")
    wear = results / f"wear/{patch}.h5"
    if wear in made:
        for depth in read_dataset(wear, only=["depth"]).depth:
            yield f"predicted_{depth.model.item()}", depth
    contact = results / f"microscale/{patch}.h5"
    if contact in made:
        yield "pressure", read_dataset(contact, only=["pressure"]).pressure


def x3p_of(heights: xr.DataArray, title: str) -> bytes:
    """An x3p file of a map of lengths (y, x) in mm, NaN where unmeasured."""
    from surfalize import Surface
    from surfalize.file.x3p import write_x3p

    dy, dx = spacing_of(heights)
    content, surface = io.BytesIO(), Surface(heights.values * 1e3, dx * 1e3, dy * 1e3)
    surface.metadata["timestamp"] = _NO_DATE
    write_x3p(content, surface, comment=title)
    return content.getvalue()


def sur_of(field: xr.DataArray, title: str) -> bytes:
    """A .sur file of a map (y, x) of any quantity, in its ``units``; NaN where unmeasured."""
    from surfalize.file.sur import LAYOUT_HEADER

    (ny, nx), (dy, dx) = field.shape, spacing_of(field)
    unknown = np.isnan(field.values)
    values = np.where(unknown, 0.0, field.values)
    step = float(np.float32(np.abs(values).max() / _LARGEST_STEP)) or 1.0
    steps = np.round(values / step).astype("<i4")
    lowest, highest = int(steps.min()), int(steps.max())
    steps[unknown] = lowest - 2  # as the format prescribes
    header = defaultdict(
        int,
        code="DIGITAL SURF",
        n_objects=1,
        version_number=1,
        studiable_type=_SURFACE,
        name_object=title[:30],
        name_operator="",
        non_measured_points=int(unknown.any()),
        absolute_z_axis=1,
        bits_per_point=32,
        min_point=lowest,
        max_point=highest,
        n_points_per_line=nx,
        n_lines=ny,
        n_total_points=nx * ny,
        day=1,
        month=1,
        year=1970,
        client_zone="",
        name_t="",
        unit_step_t="",
    )
    units = {"x": "mm", "y": "mm", "z": field.attrs["units"]}
    for (axis, unit), length in zip(units.items(), (dx, dy, step), strict=True):
        header |= {f"name_{axis}": axis.upper(), f"spacing_{axis}": length}
        header |= {f"unit_{axis}": unit, f"unit_step_{axis}": unit, f"unit_ratio_{axis}": 1.0}
    content = io.BytesIO()
    LAYOUT_HEADER.write(content, header, encoding="latin-1")
    return content.getvalue() + steps.tobytes()


def _tool(results: Path, made: set[Path]) -> bytes:
    """The tool as PLY, with pressure, patches and, of a gesture, exposure at its vertices."""
    try:
        config = json.loads((results / "provenance.json").read_text(encoding="utf-8"))["config"]
    except (OSError, ValueError, KeyError) as error:
        remedy = "Give the results folder of a finished study."
        raise InputError(results, "holds no finished study", remedy) from error
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
        for number, place in enumerate(read_table(patches).itertuples(), start=1):
            off = rotated(grid.y - place.y_mm, grid.x - place.x_mm, -place.rotation_deg)
            inside = (abs(off[0]) <= half) & (abs(off[1]) <= half)
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
