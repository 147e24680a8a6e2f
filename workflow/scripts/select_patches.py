"""Select the patches of the study by their pressure, and by how well T1 matches T0."""

import logging
from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.tables import write_table
from gstlib.change.selection import registration_table, rise_warnings, select_patches
from gstlib.io.store import Stored
from gstlib.io.tables import read_pressures


def main(
    pressures: Path,
    registered: list[Path],
    table: Path,
    registration: Path | None = None,
    *,
    worn: list[str],
    selection: dict[str, float],
    max_noise_fraction: float,
) -> None:
    changes = Stored(files_of(registered, worn), ["change", "loss", "gain"])
    quality = registration_table(changes, selection, max_noise_fraction=max_noise_fraction)
    selected = select_patches(read_pressures(pressures), quality, selection)
    doubts = [*rise_warnings(quality, max_noise_fraction=max_noise_fraction)]
    if not selected.in_study.any():
        reasons = f"{table} gives the reasons, the config's section 'selection' the rules"
        doubts.append(f"no patch enters the study: {reasons}")
    for doubt in doubts:
        logging.getLogger("gst").warning("%s", doubt)
    write_table(table, selected)
    if registration is not None:
        write_table(registration, quality)


if "snakemake" in globals():
    run_script(snakemake, main)
