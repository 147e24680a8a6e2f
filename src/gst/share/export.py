"""A finished study for other programs, and for a paper: `gst export`.

Surfaces for MountainsMap and Gwyddion, grids for a GIS, and the tool for programs that show meshes
(`gst.share.tool`). Lengths go into x3p (ISO 25178-72), as doubles in m, NaN where unmeasured. x3p
knows no other quantity: of a pressure the tool has the macroscale's, and the patches' own are in
their HDF5 files.
"""

import io
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path

import jinja2
import numpy as np
import xarray as xr

from gst.page.methods import methods_text
from gst.run.chain import PAGE, check_chain, made_in, read_record
from gst.run.received import read_provenance
from gst.share.tool import colour_bar, tool_with
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole
from gstlib.io.meshes import is_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import PatchPosition, places_of
from gstlib.surfaces.grid import MM_TO_UM, spacing_of

# The files of patches, in the folders of their batches.
_SCANS, _CHANGES, _WEAR = "surfaces/T0/*/*.h5", "change/*/*.h5", "wear/*/*.h5"
# An export is made of such files.
_WRITTEN = {".asc", ".glb", ".ply", ".png", ".txt", ".x3p"}
_UNMEASURED = -9999  # in a grid
_LIMIT = "level_of_detection"
_Places = Mapping[str, PatchPosition]
_Files = dict[str, Path]  # by patch
# The format requires a date, but the date of the export is no property of a result.
_NO_DATE = datetime(1970, 1, 1, tzinfo=UTC)


def export_study(results: Path, to: Path) -> list[str]:
    """Write the maps of every patch, and the tool, into a folder; the names of the files.

    The results may come from somebody else. Only files with the digests in the records of the steps
    are read, and no file is replaced.

    Raises an `InputError` if the folder holds no finished study, a file has changed since, its mesh
    is elsewhere, or the folder to write into has such files already.
    """
    check_chain(results)
    if there := [file for file in to.glob("*") if file.suffix in _WRITTEN]:
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
            write_whole(to / name, content)
            written.append(name)
    except (
        AttributeError,
        LookupError,
        TypeError,
        ValueError,
        jinja2.TemplateError,
    ) as error:
        problem = f"have a field that no study writes so ({error!s:.200})"
        raise InputError(results, problem, "Run the study again.") from error
    return written


def _files(results: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each file."""
    made = {*made_in(results)}  # other files may be left of other configs
    provenance = read_provenance(results)
    scans, changes, wear = (
        {file.stem.partition("_")[0]: file for file in made & {*results.glob(pattern)}}
        for pattern in (_SCANS, _CHANGES, _WEAR)
    )
    table = results / "tables/patch_pressures.csv"
    places = places_of(read_table(table)) if table in made else {}
    # first, because its mesh may be elsewhere
    yield from _tool(results, provenance["config"], made, places, changes)
    names = {file.stem for file in made if file.parent.name == "tables"}
    use = results / "tables/use.csv"
    loads = read_table(use) if use in made else None
    yield "methods.txt", methods_text(provenance, names, loads).encode()
    for patch, scan in sorted(scans.items()):
        for name, field in _maps(scan, changes.get(patch), wear.get(patch)):
            title = f"patch {patch}: {field.attrs['long_name']}"
            yield f"{patch}_{name}.x3p", _x3p_of(field, title)
            if name not in ("T0", "T1") and patch in places:
                yield f"{patch}_{name}.asc", _asc_of(field, places[patch])


def _maps(
    scan: Path, change: Path | None, wear: Path | None
) -> Iterator[tuple[str, xr.DataArray]]:
    """The maps of a patch that the study has, on the grid of T0, by the ends of their names."""
    before = read_dataset(scan, only=["height", "filled"])
    # filled points were not measured
    yield "T0", before.height.where(~before.filled)
    if change:
        registered = read_dataset(change, only=["t1", "change", _LIMIT])
        if registered.attrs["registration_found"]:
            yield "T1", registered.t1
            meaning = {"units": "mm", "long_name": "measured height loss"}
            yield "loss", (-registered.change).assign_attrs(meaning)
            yield "detection_limit", registered[_LIMIT]
    if wear:
        for depth in read_dataset(wear, only=["depth"]).depth:
            yield f"predicted_{depth.model.item()}", depth


def _x3p_of(heights: xr.DataArray, title: str) -> bytes:
    """An x3p file of a map of lengths (y, x) in mm, NaN where unmeasured."""
    from surfalize import Surface
    from surfalize.file.x3p import write_x3p

    dy, dx = spacing_of(heights)
    content, surface = io.BytesIO(), Surface(heights.values * 1e3, dx * 1e3, dy * 1e3)
    surface.metadata["timestamp"] = _NO_DATE
    write_x3p(content, surface, comment=title)
    return content.getvalue()


def _asc_of(field: xr.DataArray, place: PatchPosition) -> bytes:
    """An ESRI ASCII grid of a map of lengths (y, x) in mm, all of whose numbers are µm.

    The grid lies on the square where the patch does. It cannot be turned: that of a turned patch
    lies about the middle of the patch.
    """
    ny, nx = field.shape
    dy, dx = (MM_TO_UM * step for step in spacing_of(field))
    cells = f"cellsize {dx:.9g}" if np.isclose(dx, dy) else f"dx {dx:.9g}\ndy {dy:.9g}"
    left = MM_TO_UM * place.x_mm - nx * dx / 2
    bottom = MM_TO_UM * place.y_mm - ny * dy / 2
    corner = f"xllcorner {left:.9g}\nyllcorner {bottom:.9g}"
    header = f"ncols {nx}\nnrows {ny}\n{corner}\n{cells}\nNODATA_value {_UNMEASURED}"
    rows = np.nan_to_num(MM_TO_UM * field.values[::-1], nan=_UNMEASURED)
    content = io.BytesIO()
    np.savetxt(content, rows, "%.6g", header=header, comments="")
    return content.getvalue()


def _tool(
    results: Path, config: Mapping, made: set[Path], places: _Places, changes: _Files
) -> Iterator[tuple[str, bytes]]:
    """The tool with pressure, patches, measured loss and, of a gesture, exposure on it."""
    inputs, note = config["inputs"], ""
    unit = (inputs or {}).get("mesh_unit", "mm")
    if inputs:
        mesh = _measured(results, Path(inputs["mesh"]))
    else:
        mesh = _recorded(results / "specimen/mesh.stl", made)
        note = ", synthetic specimen"
    contact = _recorded(results / "macroscale/contact.h5", made)
    grid = read_dataset(contact, only=["pressure"]).pressure
    fields = {"pressure_MPa": grid}
    exposure = results / "gesture/exposure.h5"
    if exposure in made:
        fields["exposure_N_per_mm"] = read_dataset(exposure, only=["exposure"]).exposure
    if places:
        rows = _row_of_patch(places, grid, config["scans"]["size_mm"])
        loss = _loss_on(rows, places, changes)
        fields |= {"patch": rows} | ({"loss_um": loss} if loss.notnull().any() else {})
    face = _recorded(results / "macroscale/surface.h5", made)
    tool = tool_with(fields, mesh, unit, face)
    yield "tool.ply", tool.ply()
    for name in tool.colours:
        stem = f"tool_{name.partition('_')[0]}"
        yield f"{stem}.glb", tool.glb(name)
        yield f"{stem}.png", colour_bar(name, fields[name], note)


def _row_of_patch(places: _Places, grid: xr.DataArray, size_mm: float) -> xr.DataArray:
    """The row of the table whose patch lies over each point, from 1; 0 beside the patches."""
    rows = xr.zeros_like(grid)
    for number, place in enumerate(places.values(), start=1):
        v, u = place.seen(grid.y, grid.x)
        is_inside = (abs(v) <= size_mm / 2) & (abs(u) <= size_mm / 2)
        rows = rows.where(~is_inside.transpose(*rows.dims), number)
    return rows


def _loss_on(rows: xr.DataArray, places: _Places, changes: _Files) -> xr.DataArray:
    """The mean loss (µm) that was detected on each element; NaN where no change is known."""
    losses = rows.where(False)
    for number, (patch, place) in enumerate(places.items(), start=1):
        if file := changes.get(patch):
            change = read_dataset(file, only=["change", "loss"])
            is_worn = change.loss | change.change.isnull()
            lost = -MM_TO_UM * change.change.where(is_worn, 0).rename(y="v", x="u")
            step = max(1, round(spacing_of(rows)[0] / float(lost.v[1] - lost.v[0])))
            means = lost.coarsen(v=step, u=step, boundary="pad").mean()
            v, u = place.seen(rows.y, rows.x)
            middle = {"v": v + lost.v.mean(), "u": u + lost.u.mean()}
            losses = losses.where(rows != number, means.sel(middle, method="nearest"))
    return losses


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
