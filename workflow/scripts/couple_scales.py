"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of
from gstlib.coupling.pressures import couple_scales
from gstlib.use.outcome import pressures_of_use


def main(
    contact: Path,
    square: Path,
    use: Path,
    pressures: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
) -> None:
    pressed = (dataset_of(file, ["pressure"]).pressure for file in (contact, square))
    table = couple_scales(*pressed, pd.DataFrame(patches), patch_mm=patch_mm)
    write_table(pressures, pressures_of_use(table, dataset_of(use), patch_mm=patch_mm))


run_in_snakemake(main)
