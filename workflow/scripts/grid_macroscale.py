"""Interpolate the mesh, and the mesh of an active tool, on the square and the face around it."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import write_result
from gstlib.io.meshes import read_mesh
from gstlib.macroscale.active_tool import stated_tool
from gstlib.macroscale.face import grid_macroscale
from gstlib.preprocess.mesh import gridding_table


def main(
    mesh: Path,
    counterface: Path,
    face: Path,
    table: Path,
    second: Path | None = None,
    *,
    mesh_unit: str,
    active_tool: dict | None,
    rounded: tuple,
    gridding: dict,
) -> None:
    stone = read_mesh(mesh, unit=mesh_unit)
    tool = stated_tool(active_tool, rounded)
    gridded, of_other = grid_macroscale(
        stone, source=mesh, active_tool=tool, **gridding
    )
    write_result(face, gridded, "grid_macroscale")
    if second is not None:
        write_result(second, of_other.to_dataset(name="face"), "grid_macroscale")
    write_table(table, gridding_table(gridded))


run_in_snakemake(main)
