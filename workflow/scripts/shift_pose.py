"""Shift the active stone on the passive one, and look whether the patches keep their ranks."""

from pathlib import Path

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.study import shift_pose


def main(square: Path, pressures: Path, table: Path, **settings: float) -> None:
    surface = read_dataset(square, only=["height", "counterface", "face"])
    places = read_table(pressures, ["patch", "x_mm", "y_mm", "rotation_deg", "pressure_MPa"])
    write_table(table, shift_pose(surface, places, source=square, **settings))


if "snakemake" in globals():
    run_script(snakemake, main)
