"""Read every file of the study before any work, and say all that is wrong with them at once."""

from pathlib import Path

from gstlib.coupling import Place
from gstlib.errors import InputsError
from gstlib.inputs import ScanFile, check_inputs
from gstlib.io.tables import write_table
from gstlib.logs import run_script


def main(mesh: Path, scans: list[Path], table: Path, *, uses: list, **settings) -> None:
    """`uses` has, for every use of a scan, its file and the other fields of `ScanFile`."""
    files = [
        ScanFile(Path(file), *use, place=None if place is None else Place(*place))
        for file, (*use, place) in uses
    ]
    found = check_inputs(mesh, files, **settings)
    if found.problems:
        raise InputsError(found.problems)
    write_table(table, found.scans.drop(columns="range_um"))


if "snakemake" in globals():
    run_script(snakemake, main)
