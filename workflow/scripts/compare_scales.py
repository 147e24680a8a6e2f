"""Hold the contact of the patches against the contact of the whole square at their resolution."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gstlib.contact import LAID
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import write_table
from gstlib.validation.single_scale import two_scales_table

READ = *LAID, "pressure", "mean_pressure"


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
        variant: Stored(files_of(folders, patches), READ)
        for variant, folders in zip(variants, [contacts, others], strict=False)
    }
    write_table(table, two_scales_table(by_variant, read_dataset(reference)))


if "snakemake" in globals():
    run_script(snakemake, main)
