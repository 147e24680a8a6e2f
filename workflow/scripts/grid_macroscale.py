"""Interpolate the mesh on the analysed square and take its plane off.

Inputs: the mesh. Outputs: surface.h5 (height).
Settings: the mesh's unit, the square's frame and side, elements per side, margin.
"""

from pathlib import Path

import numpy as np

from gstlib.io.meshes import read_mesh
from gstlib.io.store import write_dataset
from gstlib.logs import job_log
from gstlib.preprocess.gridding import Frame, grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.provenance import provenance


def main(
    mesh: Path,
    surface: Path,
    *,
    mesh_unit: str,
    frame: dict,
    square_mm: float,
    grid: int,
    margin_mm: float,
) -> None:
    gridded = grid_mesh(
        read_mesh(mesh, unit=mesh_unit),
        Frame(origin=frame["origin_mm"], x_axis=frame["x_axis"], normal=frame["normal"]),
        size_mm=square_mm,
        shape=(grid, grid),
        margin_mm=margin_mm,
        source=str(mesh),
    )
    levelled, plane = remove_plane(gridded)
    settings = {
        "mesh_unit": mesh_unit,
        "frame": frame,
        "square_mm": square_mm,
        "grid": grid,
        "margin_mm": margin_mm,
    }
    attrs = {
        "tilt_x_mrad": plane.tilt_x_mrad,
        "tilt_y_mrad": plane.tilt_y_mrad,
        "Sq_um": float(np.sqrt((levelled**2).mean())) * 1e3,
    }
    write_dataset(surface, levelled.to_dataset(name="height"), attrs | provenance([mesh], settings))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.mesh),
            Path(snakemake.output.surface),
            mesh_unit=snakemake.params.mesh_unit,
            frame=snakemake.params.frame,
            square_mm=snakemake.params.square_mm,
            grid=snakemake.params.grid,
            margin_mm=snakemake.params.margin_mm,
        )
