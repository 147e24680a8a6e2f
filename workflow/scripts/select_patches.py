"""Select the patches of the study by their pressure and by the match between T1 and T0."""

import logging
from pathlib import Path

import pandas as pd

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of
from gstlib.change.selection import select_patches
from gstlib.coupling.pressures import covered_pressures
from gstlib.io.tables import read_pressures, read_table


def main(
    contact: Path,
    pressures: Path,
    registration: Path | list,
    table: Path,
    *,
    patch_mm: float,
    selection: dict[str, float],
) -> None:
    """Without scans after use, patches are selected by their pressure alone."""
    matches = read_table(registration) if registration else pd.DataFrame({"patch": []})
    pressed = dataset_of(contact, ["pressure"]).pressure
    bear = covered_pressures(
        read_pressures(pressures), pressed, matches, patch_mm=patch_mm
    )
    selected = select_patches(bear, matches, selection)
    if not selected.in_study.any():
        reasons = (
            f"{table} gives the reasons, the config's section 'selection' the rules"
        )
        logging.getLogger("gst").warning("no patch enters the study: %s", reasons)
    write_table(table, selected)


run_in_snakemake(main)
