"""Combine the poses of a gesture: the exposure of the face and, if there are any, of each patch."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, write_result
from gstlib.io.tables import read_table
from gstlib.macroscale.gesture import exposure, exposure_table


def main(
    batches: list[Path], pressures: Path | list, fields: Path, table: Path | None = None
) -> None:
    left = exposure(dataset_of(batch) for batch in batches)
    write_result(fields, left, "gather_exposure")
    if table is not None:
        by_patch = read_table(pressures, ["patch", "pressure_MPa"])
        write_table(table, exposure_table(left, by_patch))


run_in_snakemake(main)
