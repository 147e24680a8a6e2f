"""Solve the macroscale with each reading of the contact modulus, and set them side by side.

Inputs: surface.h5, patch_pressures.csv (where the patches lie). Outputs: sensitivity.csv.
Settings: the contact moduli by name, patch side, target pressure, tolerance.
"""

from pathlib import Path

import pandas as pd

from gstlib.contact import solve_at_pressure
from gstlib.coupling import patch_pressures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log


def main(
    surface: Path,
    pressures: Path,
    table: Path,
    *,
    moduli_MPa: dict[str, float],
    patch_mm: float,
    target_pressure_MPa: float,
    tolerance: float,
    threads: int,
) -> None:
    height = read_dataset(surface).height
    patches = read_table(pressures)
    rows = []
    for basis, modulus in moduli_MPa.items():
        state, pressure = solve_at_pressure(
            height,
            source=surface,
            contact_modulus_MPa=modulus,
            target_pressure_MPa=target_pressure_MPa,
            tolerance=tolerance,
            workers=threads,
        )
        by_patch = patch_pressures(pressure, patches, size_mm=patch_mm)
        rows += [
            (basis, "contact modulus", "", "MPa", float(modulus)),
            (basis, "displacement", "", "um", state.displacement * 1e3),
            (basis, "contact fraction", "", "1", state.contact_fraction),
        ]
        rows += [
            (basis, "patch pressure", row.patch, "MPa", float(row.pressure_MPa))
            for row in by_patch.itertuples()
        ]
    write_table(
        table, pd.DataFrame(rows, columns=["contact_modulus", "quantity", "patch", "unit", "value"])
    )


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.surface),
            Path(snakemake.input.pressures),
            Path(snakemake.output.table),
            moduli_MPa=snakemake.params.moduli_MPa,
            patch_mm=snakemake.params.patch_mm,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            tolerance=snakemake.params.tolerance,
            threads=snakemake.threads,
        )
