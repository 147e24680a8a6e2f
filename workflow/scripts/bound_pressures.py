"""Say how sure the pressure of each patch is, given the errors of mesh, places and constants."""

from pathlib import Path

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, write_table
from gstlib.study import bound_pressures


def main(surface: Path, composite: Path, pressures: Path, table: Path, **settings) -> None:
    composed = read_dataset(composite) if composite else None
    limits = bound_pressures(
        read_dataset(surface), composed, read_pressures(pressures), source=surface, **settings
    )
    write_table(table, limits)


if "snakemake" in globals():
    run_script(snakemake, main)
