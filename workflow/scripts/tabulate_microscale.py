"""Tabulate the microscale contacts of the patches in the study."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import files_of
from gstlib.io.store import Stored
from gstlib.io.tables import studied_files
from gstlib.microscale.patches import LOAD_PATHS, microscale_tables


def main(
    contacts: list[Path],
    pressures: Path,
    summary: Path,
    paths: Path,
    *,
    patches: list[str],
) -> None:
    files = files_of(contacts, patches)
    studied = studied_files(pressures, patches, [*files.values()])
    states, steps = microscale_tables(Stored(studied, LOAD_PATHS))
    write_table(summary, states)
    write_table(paths, steps)


run_in_snakemake(main)
