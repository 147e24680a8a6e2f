"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.tables import write_table
from gstlib.coupling.pressures import couple_scales
from gstlib.io.store import read_dataset
from gstlib.macroscale.equilibrium import solve_square


def main(
    face: Path,
    contact: Path,
    pressures: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
    force_N: float,
    contact_modulus_MPa: float,
    tolerance: float,
) -> None:
    alone = solve_square(
        read_dataset(face, only=["height", "size_mm"]),
        force_N=force_N,
        modulus=contact_modulus_MPa,
        tolerance=tolerance,
        source=face,
    )
    whole = read_dataset(contact, only=["pressure"]).pressure
    table = couple_scales(whole, alone.pressure, pd.DataFrame(patches), patch_mm=patch_mm)
    write_table(pressures, table)


if "snakemake" in globals():
    run_script(snakemake, main)
