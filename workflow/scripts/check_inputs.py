"""Read every file of the study before any work, and report all problems at once."""

from pathlib import Path

from gst.check.inputs import Asked, check_inputs
from gst.config.patches import ScanFile
from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gstlib.errors import InputsError


def main(
    mesh: Path,
    counterface: Path,
    scans: list[Path],
    table: Path,
    *,
    uses: list[ScanFile],
    asked: dict,
) -> None:
    """`uses` describe the `scans`; `asked` contains the path of the `counterface`."""
    checked = check_inputs(mesh, uses, Asked(**asked))
    if checked.problems:
        raise InputsError(checked.problems)
    write_table(table, checked.scans.drop(columns="range_um"))


run_in_snakemake(main)
