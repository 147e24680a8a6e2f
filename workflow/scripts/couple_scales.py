"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gstlib.contact import contact_at_pressure, faces_of
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.study import couple_scales


def main(
    surface: Path,
    contact: Path,
    pressures: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
    **settings: float,
) -> None:
    final = read_dataset(contact, only=["pressure"]).isel(step=-1)
    alone = contact_at_pressure(faces_of(read_dataset(surface)), source=surface, **settings)
    table = couple_scales(final, alone, pd.DataFrame(patches), patch_mm=patch_mm)
    write_table(pressures, table)


if "snakemake" in globals():
    run_script(snakemake, main)
