"""Score every stage against the synthetic specimen's truth."""

from pathlib import Path

from gst.batches import files_by_epoch, files_of
from gst.logs import run_script
from gst.tables import write_table
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
    two_scales: Path,
    use: Path,
    table: Path,
    *,
    patches: list[str],
    worn: list[str],
) -> None:
    scores = score_truth(
        read_dataset(truth),
        face=read_dataset(surface, only=["height"]),
        scans=Stored(files_by_epoch({"T0": t0, "T1": t1}, patches)),
        changes=Stored(files_of(registered, worn), ["change", "loss"]),
        placement=read_table(placement),
        pressures=read_pressures(pressures),
        two_scales=read_table(two_scales) if two_scales else None,
        use=read_table(use) if use else None,
    )
    write_table(table, scores)


if "snakemake" in globals():
    run_script(snakemake, main)
