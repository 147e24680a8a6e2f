"""Solve the additional cases of the config: a grinding force, and a cap on the pressure."""

from pathlib import Path
from typing import Any

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import files_of
from gstlib.contact import Contact
from gstlib.io.store import Stored
from gstlib.io.tables import studied_files
from gstlib.microscale.slip_and_cap import case_table


def main(
    contacts: list[Path],
    pressures: Path,
    table: Path,
    *,
    patches: list[str],
    **settings: Any,
) -> None:
    """`settings` are arguments of `case_table`."""
    files = files_of(contacts, patches)
    studied = studied_files(pressures, patches, [*files.values()])
    solved = Stored(studied, then=Contact.from_dataset)
    write_table(table, case_table(solved, **settings))


run_in_snakemake(main)
