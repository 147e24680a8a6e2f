"""Hold the contact of the patches against the contact of the whole square at their resolution."""

from pathlib import Path

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.study import compare_scales


def main(
    reference: Path,
    contacts: list[Path],
    others: list[Path],
    table: Path,
    *,
    patches: list[str],
    variants: list[str],
    rim: float,
) -> None:
    found = {
        variant: (
            (patch, read_dataset(file)) for patch, file in zip(patches, files, strict=True)
        )
        for variant, files in zip(variants, [contacts, others], strict=False)
    }
    write_table(table, compare_scales(found, read_dataset(reference), rim=rim))


if "snakemake" in globals():
    run_script(snakemake, main)
