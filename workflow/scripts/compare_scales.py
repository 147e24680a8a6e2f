"""Compare the contact of the patches with the contact of the whole square at their resolution."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.contacts import contacts_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of
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
    write_table(table, two_scales_table(by_variant, dataset_of(reference)))


run_in_snakemake(main)
