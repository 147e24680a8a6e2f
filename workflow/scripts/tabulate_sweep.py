"""Gather what came out of every setting of the sweep, beside what came out of the study.

Inputs: the outcomes of each setting. Outputs: sweep.csv. Settings: `sweep` of the config.
"""

from pathlib import Path

from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log
from gstlib.sweep.factors import sweep_settings
from gstlib.sweep.table import sweep_table


def main(files: list[Path], table: Path, *, sweep: dict) -> None:
    outcomes = {file.stem: read_table(file).fillna({"patch": ""}) for file in files}
    write_table(table, sweep_table(sweep_settings(sweep), outcomes))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            [Path(file) for file in snakemake.input.outcomes],
            Path(snakemake.output.table),
            sweep=snakemake.params.sweep,
        )
