"""Score every stage against the known truth of the synthetic specimen."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.batches import files_by_epoch, files_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import table_of
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.specimen.score import score_truth


def main(
    truth: Path,
    surface: Path,
    placement: Path,
    pressures: Path,
    t0: list[Path],
    t1: list[Path],
    registered: list[Path],
    two_scales: Path | list,
    use: Path | list,
    table: Path,
    *,
    patches: list[str],
) -> None:
    scores = score_truth(
        read_dataset(truth),
        placement=read_table(placement),
        pressures=read_pressures(pressures),
        two_scales=table_of(two_scales),
        use=table_of(use),
        face=read_dataset(surface, only=["height"]),
        scans=Stored(files_by_epoch({"T0": t0, "T1": t1}, patches)),
        changes=Stored(files_of(registered, patches), ["change", "loss"]),
    )
    write_table(table, scores)


run_in_snakemake(main)
