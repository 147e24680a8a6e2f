"""Propose positions to scan: the most exposed ones, and some without contact."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of
from gstlib.macroscale.sampling_sites import propose_places


def main(exposure: Path, table: Path, *, size_mm: float, patch_mm: float) -> None:
    fields = dataset_of(exposure, ["exposure", "touched"])
    write_table(table, propose_places(fields, size_mm=size_mm, patch_mm=patch_mm))


run_in_snakemake(main)
