"""Tabulate the preparation of each scan."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import files_by_epoch
from gstlib.io.store import read_attributes
from gstlib.preprocess.scans import preprocessing_table


def main(
    t0: list[Path],
    t1: list[Path],
    repeats: list[Path],
    table: Path,
    *,
    patches: list[str],
) -> None:
    files = files_by_epoch({"T0": t0, "T1": t1, "repeat": repeats}, patches)
    done = {scan: read_attributes(file) for scan, file in files.items()}
    write_table(table, preprocessing_table(done))


run_in_snakemake(main)
