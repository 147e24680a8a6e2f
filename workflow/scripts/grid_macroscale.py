"""Interpolate the mesh on the analysed square and remove the plane."""

from pathlib import Path

from gstlib.io.meshes import read_mesh
from gstlib.io.store import write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import run_script
from gstlib.provenance import provenance
from gstlib.study import grid_macroscale, gridding_table


def main(mesh: Path, surface: Path, table: Path, *, mesh_unit: str, **settings) -> None:
    stone = read_mesh(mesh, unit=mesh_unit)
    gridded = grid_macroscale(stone, source=mesh, **settings)
    write_dataset(surface, gridded, provenance([mesh], {"mesh_unit": mesh_unit} | settings))
    write_table(table, gridding_table(gridded))


if "snakemake" in globals():
    run_script(snakemake, main)
