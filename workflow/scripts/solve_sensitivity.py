"""Solve the macroscale with each reading of the contact modulus."""

from pathlib import Path

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, write_table
from gstlib.study import compare_moduli


def main(surface: Path, pressures: Path, table: Path, **settings) -> None:
    square = read_dataset(surface)
    write_table(
        table, compare_moduli(square, read_pressures(pressures), source=surface, **settings)
    )


if "snakemake" in globals():
    run_script(snakemake, main)
