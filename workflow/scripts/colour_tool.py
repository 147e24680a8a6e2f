"""Lay pressure and exposure on the tool, as numbers at its vertices, for other programs."""

from pathlib import Path

from gst.figures.tool import cut_tool
from gst.logs import run_script
from gstlib.geometry import FRAME, on_mesh, stored_frame
from gstlib.io.files import write_whole
from gstlib.io.meshes import ply_with, read_mesh
from gstlib.io.store import read_dataset
from gstlib.surface import spacing_of


def main(
    mesh: Path, face: Path, contact: Path, exposure: Path, tool: Path, *, mesh_unit: str
) -> None:
    stone = read_mesh(mesh, unit=mesh_unit)
    frame = stored_frame(read_dataset(face, only=FRAME))
    fields = {
        "pressure_MPa": read_dataset(contact, only=["pressure"]).pressure,
        "exposure_N_per_mm": read_dataset(exposure, only=["exposure"]).exposure,
    }
    first = fields["pressure_MPa"]
    edge_mm = 1.5 * max(spacing_of(first))
    cut = cut_tool(stone, frame, first, edge_mm=edge_mm, faces=len(stone.faces))
    values = {name: on_mesh(field, cut, frame) for name, field in fields.items()}
    write_whole(tool, ply_with(cut, values, unit=mesh_unit))


if "snakemake" in globals():
    run_script(snakemake, main)
