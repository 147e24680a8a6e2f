"""Write pressure and exposure as numbers at the vertices of the tool, for other programs."""

from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.share.tool import tool_with
from gstlib.io.files import write_whole
from gstlib.io.store import read_dataset


def main(
    mesh: Path, face: Path, contact: Path, exposure: Path, tool: Path, *, mesh_unit: str
) -> None:
    fields = {
        "pressure_MPa": read_dataset(contact, only=["pressure"]).pressure,
        "exposure_N_per_mm": read_dataset(exposure, only=["exposure"]).exposure,
    }
    write_whole(tool, tool_with(fields, mesh, mesh_unit, face).ply())


run_in_snakemake(main)
