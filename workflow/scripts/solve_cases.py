"""Solve what the config asks for: a grinding force, a ceiling."""

from collections.abc import Mapping
from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.tables import write_table
from gstlib.contact import Contact
from gstlib.io.store import Stored
from gstlib.io.tables import read_pressures, studied_files
from gstlib.microscale.slip_and_cap import case_table, check_ceiling, patch_rows


def main(
    contacts: list[Path],
    pressures: Path,
    table: Path,
    *,
    patches: list[str],
    grinding: Mapping[str, float] | None,
    hardness_MPa: float | None,
) -> None:
    files = files_of(contacts, patches)
    studied = studied_files(pressures, patches, [*files.values()])
    if hardness_MPa is not None:
        by_patch = read_pressures(pressures)
        check_ceiling(by_patch[by_patch.patch.isin(studied)], hardness_MPa)
    rows = patch_rows(
        Stored(studied, then=Contact.from_dataset), grinding=grinding, hardness_MPa=hardness_MPa
    )
    write_table(table, case_table(rows))


if "snakemake" in globals():
    run_script(snakemake, main)
