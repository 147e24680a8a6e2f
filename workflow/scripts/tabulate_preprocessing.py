"""Tabulate what was done to each scan."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.tables import write_table
from gstlib.io.store import read_attributes
from gstlib.preprocess.scans import preprocessing_table


def main(
    t0: list[Path], t1: list[Path], repeats: list[Path], table: Path, *, patches: list[str]
) -> None:
    epochs = {"T0": t0, "T1": t1, "repeat": repeats}
    files = {epoch: files_of(folders, patches) for epoch, folders in epochs.items()}
    done = {
        (patch, epoch): read_attributes(files[epoch][patch])
        for patch in patches
        for epoch in epochs
        if patch in files[epoch]
    }
    write_table(table, preprocessing_table(done))


if "snakemake" in globals():
    run_script(snakemake, main)
