"""Tabulate the results of every setting of the sweep beside those of the study."""

from pathlib import Path

from gst.logs import run_script
from gst.sweep import sweep_settings, sweep_table
from gstlib.io.tables import read_table, write_table


def main(outcomes: list[Path], table: Path, *, sweep: dict) -> None:
    found = {file.stem: read_table(file).fillna({"patch": ""}) for file in outcomes}
    write_table(table, sweep_table(sweep_settings(sweep), found))


if "snakemake" in globals():
    run_script(snakemake, main)
