"""Tabulate the microscale contacts of the patches in the study."""

from pathlib import Path

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import studied_files, write_table
from gstlib.study import microscale_tables


def main(
    contacts: list[Path], pressures: Path, summary: Path, paths: Path, *, patches: list[str]
) -> None:
    files = studied_files(pressures, patches, contacts)
    states, steps = microscale_tables(
        (patch, read_dataset(file)) for patch, file in files.items()
    )
    write_table(summary, states)
    write_table(paths, steps)


if "snakemake" in globals():
    run_script(snakemake, main)
