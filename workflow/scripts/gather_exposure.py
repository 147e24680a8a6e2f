"""Put the poses of a gesture together: their exposure, and that of each patch."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.study import gather_exposure


def main(batches: list[Path], pressures: Path, exposure: Path, table: Path) -> None:
    found, rows = gather_exposure(
        (read_dataset(batch) for batch in batches),
        read_table(pressures, ["patch", "pressure_MPa"]),
    )
    write_dataset(exposure, found, provenance(batches, {}))
    write_table(table, rows)


if "snakemake" in globals():
    run_script(snakemake, main)
