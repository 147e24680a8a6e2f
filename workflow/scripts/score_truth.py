"""Score every stage against the known truth of the synthetic specimen."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import changes_of, dataset_of, files_by_epoch, table_of
from gstlib.io.store import Stored
from gstlib.io.tables import read_pressures
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
        dataset_of(truth),
        placement=table_of(placement),
        pressures=read_pressures(pressures),
        two_scales=table_of(two_scales),
        use=table_of(use),
        face=dataset_of(surface, ["height"]),
        scans=Stored(files_by_epoch({"T0": t0, "T1": t1}, patches)),
        changes=changes_of(registered, patches, ["change", "loss"]),
    )
    write_table(table, scores)


run_in_snakemake(main)
