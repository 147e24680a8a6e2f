"""Interpolate the mesh, and that of a second stone, on the analysed square and remove the plane."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.counterface import read_counterface
from gstlib.io.meshes import read_mesh
from gstlib.io.store import write_dataset
from gstlib.io.tables import write_table
from gstlib.study import grid_macroscale, gridding_table


def main(
    mesh: Path,
    counterface: Path,
    surface: Path,
    table: Path,
    *,
    mesh_unit: str,
    second_stone: dict | None,
    **settings,
) -> None:
    stone, other = read_mesh(mesh, unit=mesh_unit), None
    if second_stone:
        other = read_counterface(second_stone)
    gridded = grid_macroscale(stone, source=mesh, counterface=other, **settings)
    inputs = [mesh, *([counterface] if second_stone else [])]
    write_dataset(surface, gridded, provenance(inputs, {"mesh_unit": mesh_unit} | settings))
    write_table(table, gridding_table(gridded))


if "snakemake" in globals():
    run_script(snakemake, main)
