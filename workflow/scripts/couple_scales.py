"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.logs import run_script
from gstlib.study import couple_scales


def main(contact: Path, pressures: Path, *, patches: dict[str, list], **settings) -> None:
    final = read_dataset(contact, only=["pressure"]).isel(step=-1)
    write_table(pressures, couple_scales(final, pd.DataFrame(patches), **settings))


if "snakemake" in globals():
    run_script(snakemake, main)
