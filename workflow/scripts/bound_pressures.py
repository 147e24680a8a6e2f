"""Say how sure the pressure of each patch is, by its place and by what the stones may be made of.

Inputs: surface.h5 and contact.h5 of the macroscale, patch_pressures.csv. Outputs:
patch_intervals.csv. Settings: elastic constants, contact modulus, target pressure, tolerance,
patch side, `uncertainty` of the config.
"""

from pathlib import Path

import numpy as np

from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log
from gstlib.uncertainty import draw_contact_moduli, pressure_intervals, pressures_of_moduli


def main(
    surface: Path,
    contact: Path,
    pressures: Path,
    table: Path,
    *,
    material: dict[str, float],
    patch_mm: float,
    placement_um: float,
    young_share: float,
    poisson: float,
    draws: int,
    seed: int,
    **settings: float,
) -> None:
    shares = draw_contact_moduli(
        material,
        young_share=young_share,
        poisson=poisson,
        draws=draws,
        generator=np.random.default_rng(seed),
    )
    solved = pressures_of_moduli(
        read_dataset(surface).height,
        read_dataset(contact).pressure.isel(step=-1),
        shares,
        source=surface,
        **settings,
    )
    intervals = pressure_intervals(
        read_table(pressures),
        solved,
        shares,
        size_mm=patch_mm,
        placement_um=placement_um,
        # a patch draws the same whichever others are in the table
        generator_of=lambda patch: np.random.default_rng([seed, *patch.encode()]),
    )
    write_table(table, intervals)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.surface),
            Path(snakemake.input.contact),
            Path(snakemake.input.pressures),
            Path(snakemake.output.table),
            material=snakemake.params.material,
            patch_mm=snakemake.params.patch_mm,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            tolerance=snakemake.params.tolerance,
            **snakemake.params.uncertainty,
        )
