"""Write pressure and exposure as numbers at the vertices of the tool, for other programs."""

from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of
from gst.share.tool import tool_with
from gstlib.io.files import write_whole


def main(
    mesh: Path, face: Path, contact: Path, exposure: Path, tool: Path, *, mesh_unit: str
) -> None:
    fields = {
        "pressure_MPa": dataset_of(contact, ["pressure"]).pressure,
        "exposure_N_per_mm": dataset_of(exposure, ["exposure"]).exposure,
    }
    write_whole(tool, tool_with(fields, mesh, mesh_unit, face).ply())


run_in_snakemake(main)
