"""Make the generated specimen: its mesh, its scans before and after use, and the truth.

Inputs: the patch table. Outputs: mesh (STL), scans (.plu), truth (HDF5).
Settings: the config section `specimen`, the square's side, the macroscale grid.
"""

from pathlib import Path

import pandas as pd

from gstlib.logs import job_log
from gstlib.specimen import SpecimenParameters, generate_specimen


def main(
    patches: pd.DataFrame,
    mesh: Path,
    scan_folder: Path,
    truth: Path,
    *,
    specimen: dict,
    square_mm: float,
    grid: int,
) -> None:
    generate_specimen(
        patches,
        mesh=mesh,
        scan_folder=scan_folder,
        truth=truth,
        square_mm=square_mm,
        grid=grid,
        parameters=SpecimenParameters(**specimen),
    )


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            pd.DataFrame(snakemake.params.patches),
            Path(snakemake.output.mesh),
            Path(snakemake.output.scans[0]).parent,
            Path(snakemake.output.truth),
            specimen=snakemake.params.specimen,
            square_mm=snakemake.params.square_mm,
            grid=snakemake.params.grid,
        )
