"""Interpolate the mesh on the analysed square and take its plane off.

Inputs: the mesh, a file that outlines the square (if the config names one). Outputs: surface.h5
(height, and what piercing the faces differs by), gridding.csv.
Settings: the mesh's unit, the square's side and frame, elements per side, margin.
"""

from pathlib import Path

import numpy as np

from gstlib.io.meshes import read_mesh
from gstlib.io.store import write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.preprocess.crosscheck import compare_gridding, gridding_attributes
from gstlib.preprocess.frame import find_frame
from gstlib.preprocess.gridding import grid_both_ways
from gstlib.preprocess.leveling import remove_plane
from gstlib.provenance import provenance


def main(
    mesh: Path,
    marker: Path | None,
    surface: Path,
    table: Path,
    *,
    mesh_unit: str,
    square: dict,
    grid: int,
    margin_mm: float,
) -> None:
    stone = read_mesh(mesh, unit=mesh_unit)
    frame = find_frame(square, stone, unit=mesh_unit, source=str(mesh))
    gridded = grid_both_ways(
        stone,
        frame,
        size_mm=square["size_mm"],
        shape=(grid, grid),
        margin_mm=margin_mm,
        source=str(mesh),
    )
    levelled, plane = remove_plane(gridded.height)
    difference, comparison = compare_gridding(gridded)
    settings = {"mesh_unit": mesh_unit, "square": square, "grid": grid, "margin_mm": margin_mm}
    attrs = {
        "origin_mm": frame.origin,
        "x_axis": frame.x_axis,
        "normal": frame.normal,
        "tilt_x_mrad": plane.tilt_x_mrad,
        "tilt_y_mrad": plane.tilt_y_mrad,
        "Sq_um": float(np.sqrt((levelled**2).mean())) * 1e3,
    }
    attrs |= gridding_attributes(comparison)
    attrs |= provenance([mesh] if marker is None else [mesh, marker], settings)
    dataset = levelled.to_dataset(name="height").assign(gridding_difference=difference)
    write_dataset(surface, dataset, attrs)
    write_table(table, comparison)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.mesh),
            Path(snakemake.input.marker) if snakemake.input.marker else None,
            Path(snakemake.output.surface),
            Path(snakemake.output.table),
            mesh_unit=snakemake.params.mesh_unit,
            square=snakemake.params.square,
            grid=snakemake.params.grid,
            margin_mm=snakemake.params.margin_mm,
        )
