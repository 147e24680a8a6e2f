"""Solve what the config asks for: a grinding force, a cap."""

from collections.abc import Mapping
from pathlib import Path

from gst.config.tables import write_table
from gst.run.batches import files_of
from gst.run.logs import run_script
from gstlib.contact import Contact
from gstlib.io.store import Stored
from gstlib.io.tables import studied_files
from gstlib.microscale.slip_and_cap import case_table, patch_rows


def main(
    contacts: list[Path],
    pressures: Path,
    table: Path,
    *,
    patches: list[str],
    grinding: Mapping[str, float] | None,
    pressure_cap: float | None,
) -> None:
    files = files_of(contacts, patches)
    studied = studied_files(pressures, patches, [*files.values()])
    rows = patch_rows(
        Stored(studied, then=Contact.from_dataset), grinding=grinding, pressure_cap=pressure_cap
    )
    write_table(table, case_table(rows))


if "snakemake" in globals():
    run_script(snakemake, main)
