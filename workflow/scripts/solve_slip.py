"""Load the patches of the study tangentially: where do they stick, and where do they slip?

One job for all patches: a job takes longer to start than to solve one.
"""

from pathlib import Path

import pandas as pd

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.contact import slip_summary
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import studied_files, write_table
from gstlib.study import solve_slip


def main(
    contacts: list[Path],
    pressures: Path,
    folder: Path,
    table: Path,
    *,
    patches: list[str],
    **settings: float,
) -> None:
    rows = []
    for patch, file in patch_by_patch(studied_files(pressures, patches, contacts)):
        contact = read_dataset(file)
        solved = solve_slip(contact, source=file, **settings)
        write_dataset(folder / f"{patch}.h5", solved, provenance([file], settings))
        rows.append({"patch": patch} | slip_summary(solved))
    folder.mkdir(parents=True, exist_ok=True)
    write_table(table, pd.DataFrame(rows, columns=None if rows else ["patch"]))


if "snakemake" in globals():
    run_script(snakemake, main)
