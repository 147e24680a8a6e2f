"""Say how sure the pressure of each patch is, given its place and the stones' elastic constants."""

from pathlib import Path

from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import run_script
from gstlib.study import bound_pressures


def main(surface: Path, contact: Path, pressures: Path, table: Path, **settings) -> None:
    final = read_dataset(contact, only=["pressure"]).isel(step=-1)
    square = read_dataset(surface, only=["height"])
    write_table(
        table, bound_pressures(square, final, read_table(pressures), source=surface, **settings)
    )


if "snakemake" in globals():
    run_script(snakemake, main)
