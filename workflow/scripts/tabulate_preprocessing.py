"""Tabulate what was done to each scan."""

from pathlib import Path

from gst.logs import run_script
from gst.tables import write_table
from gstlib.io.store import read_attributes
from gstlib.preprocess.scans import preprocessing_table


def main(
    t0: list[Path],
    t1: list[Path],
    repeats: list[Path],
    table: Path,
    *,
    patches: list[str],
    worn: list[str],
    repeated: list[str],
) -> None:
    of_epochs = {"T0": (patches, t0), "T1": (worn, t1), "repeat": (repeated, repeats)}
    done = {
        (patch, epoch): read_attributes(file)
        for epoch, (scanned, files) in of_epochs.items()
        for patch, file in zip(scanned, files, strict=True)
    }
    order = {patch: place for place, patch in enumerate(patches)}
    scans = sorted(done, key=lambda scan: (order[scan[0]], scan[1]))
    write_table(table, preprocessing_table({scan: done[scan] for scan in scans}))


if "snakemake" in globals():
    run_script(snakemake, main)
