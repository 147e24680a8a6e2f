"""Press the patches of the study again, with a ceiling on the pressure.

One job for all patches: a job takes longer to start than to solve one.
"""

from pathlib import Path

import pandas as pd

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.contact import hardness_summary
from gstlib.errors import ConfigError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_pressures, studied_files, write_table
from gstlib.study import solve_hardness


def main(
    contacts: list[Path],
    pressures: Path,
    folder: Path,
    table: Path,
    *,
    patches: list[str],
    hardness_MPa: float,
) -> None:
    files = studied_files(pressures, patches, contacts)
    pressure_MPa = read_pressures(pressures).set_index("patch").pressure_MPa
    soft = pressure_MPa[list(files)][lambda pressure: pressure >= hardness_MPa]
    if len(soft):
        raise ConfigError(
            "config",
            f"'hardness' is {hardness_MPa:g} MPa, not above the mean pressure of patch "
            + ", ".join(f"{patch} ({pressure:.4g} MPa)" for patch, pressure in soft.items()),
            "Raise it, or set it to null.",
        )
    rows, settings = [], {"hardness_MPa": hardness_MPa}
    for patch, file in patch_by_patch(files):
        contact = read_dataset(file)
        solved = solve_hardness(contact, source=file, **settings)
        write_dataset(folder / f"{patch}.h5", solved, provenance([file], settings))
        rows.append({"patch": patch} | hardness_summary(contact, solved))
    folder.mkdir(parents=True, exist_ok=True)
    write_table(table, pd.DataFrame(rows, columns=None if rows else ["patch"]))


if "snakemake" in globals():
    run_script(snakemake, main)
