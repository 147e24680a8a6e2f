"""Compare the contact of the patches with the contact of the whole square at their resolution."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import contacts_of
from gstlib.io.store import read_dataset
from gstlib.validation.single_scale import two_scales_table


def main(
    reference: Path,
    contacts: list[Path],
    others: list[Path],
    table: Path,
    *,
    patches: list[str],
    variants: list[str],
) -> None:
    by_variant = {
        variant: contacts_of(folders, patches)
        for variant, folders in zip(variants, [contacts, others], strict=False)
    }
    write_table(table, two_scales_table(by_variant, read_dataset(reference)))


run_in_snakemake(main)
