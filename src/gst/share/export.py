"""A finished study for other programs: `gst export`.

Surfaces for MountainsMap and Gwyddion, the tool for CloudCompare, MeshLab and Blender. Lengths go
into x3p (ISO 25178-72), as doubles in m, NaN where unmeasured. x3p knows no other quantity: of a
pressure the tool has the macroscale's, and the patches' own are in their HDF5 files.
"""

import io
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import xarray as xr

from gst.page.figures.tool import cut_tool
from gst.run.chain import PAGE, check_chain, made_in, read_record
from gst.run.received import read_provenance
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole
from gstlib.io.meshes import is_mesh, ply_with, read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import places_of
from gstlib.surfaces.frames import FRAME, on_mesh, stored_frame
from gstlib.surfaces.grid import spacing_of

__all__ = ["export_study", "tool_with", "x3p_of"]

# The files of each patch, in the folders of their batches.
_BY_PATCH = {
    "T0": "surfaces/T0/*/*.h5",
    "change": "change/*/*.h5",
    "wear": "wear/*/*.h5",
}
_TOOL = "tool.ply"
# The format asks for a date; that of the export says nothing about a result.
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)


def export_study(results: Path, to: Path) -> list[Path]:
    """Write the maps of every patch, and the tool, into a folder; the files written.

    The results may come from somebody else. Only files with the digests in the records of the steps
    are read, and no file is replaced.

    Raises an `InputError` if the folder holds no finished study, a file has changed since, its mesh
    is elsewhere, or the folder to write into has such files already.
    """
    check_chain(results)
    if there := [*to.glob("*.x3p"), *to.glob(_TOOL)]:
        remedy = (
            "Remove the files of an earlier export, or give another folder with --to."
        )
        raise InputError(to, f"has the file {min(there).name} already", remedy)
    written = []
    try:
        for name, content in _files(results):
            if Path(name).name != name:
                problem = f"holds the name of a file outside the export: {name!r}"
                raise InputError(results, problem, "Run the study again.")
            written.append(to / name)
            write_whole(written[-1], content)
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        problem = f"have a field that no study writes so ({error!s:.200})"
        raise InputError(results, problem, "Run the study again.") from error
    return written


def _files(results: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each file."""
    made = {*made_in(results)}  # other files may be left of other configs
    yield _TOOL, _tool(results, made)  # first, because its mesh may be elsewhere
    by_patch: dict[str, dict[str, Path]] = {}
    for stage, pattern in _BY_PATCH.items():
        for file in made & set(results.glob(pattern)):
            patch = file.stem.partition("_")[0]
            by_patch.setdefault(patch, {})[stage] = file
    for patch, stages in sorted(by_patch.items()):
        for name, field in _maps(stages):
            title = f"patch {patch}: {field.attrs['long_name']}"
            yield f"{patch}_{name}.x3p", x3p_of(field, title)


def _maps(files: Mapping[str, Path]) -> Iterator[tuple[str, xr.DataArray]]:
    """The maps of a patch that the study has, on the grid of T0, by the ends of their names."""
    before = read_dataset(files["T0"], only=["height", "filled"])
    # what was filled from around it was not measured
    yield "T0", before.height.where(~before.filled)
    if change := files.get("change"):
        registered = read_dataset(change, only=["t1", "change"])
        if registered.attrs["registration_found"]:
            yield "T1", registered.t1
            loss = -registered.change
            yield (
                "loss",
                loss.assign_attrs(units="mm", long_name="measured height loss"),
            )
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
    config = read_provenance(results, "inputs", "scans")["config"]
    inputs = config["inputs"]
    if inputs is None:
        mesh, unit = _recorded(results / "specimen/mesh.stl", made), "mm"
    else:
        mesh, unit = (
            _measured(results, Path(inputs["mesh"])),
            inputs.get("mesh_unit", "mm"),
        )
    contact = _recorded(results / "macroscale/contact.h5", made)
    grid = read_dataset(contact, only=["pressure"]).pressure
    fields = {"pressure_MPa": grid}
    exposure = results / "gesture/exposure.h5"
    if exposure in made:
        fields["exposure_N_per_mm"] = read_dataset(exposure, only=["exposure"]).exposure
    patches = results / "tables/patch_pressures.csv"
    if patches in made:
        fields["patch"] = _row_of_patch(patches, grid, config["scans"]["size_mm"])
    face = _recorded(results / "macroscale/surface.h5", made)
    return tool_with(fields, mesh, unit, face)


def _row_of_patch(table: Path, grid: xr.DataArray, size_mm: float) -> xr.DataArray:
    """The row of the table whose patch lies over each point, from 1; 0 beside the patches."""
    rows = xr.zeros_like(grid)
    places = places_of(read_table(table, ["patch", "x_mm", "y_mm", "rotation_deg"]))
    for number, place in enumerate(places.values(), start=1):
        v, u = place.seen(grid.y, grid.x)
        is_inside = (abs(v) <= size_mm / 2) & (abs(u) <= size_mm / 2)
        rows = rows.where(~is_inside.transpose(*rows.dims), number)
    return rows


def _recorded(file: Path, made: set[Path]) -> Path:
    """A file that a step of the study made; raises an `InputError` if none did."""
    if file not in made:
        raise InputError(
            file, "was made by no step of this study", "Run the study again."
        )
    return file


def _measured(results: Path, mesh: Path) -> Path:
    """The mesh of the study, wherever it is, if it is the one that the page was made from.

    Who names a file of somebody else in results cannot know its digest.
    """
    page = read_record(results, PAGE) or {"files": {}}
    digest = page["files"].get(mesh.as_posix())
    if digest and is_mesh(mesh) and mesh.is_file() and sha256(mesh) == digest:
        return mesh
    problem = "is not there, or is not the mesh that the page was made from"
    raise InputError(mesh, problem, "Export the study in the folder where it ran.")


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
