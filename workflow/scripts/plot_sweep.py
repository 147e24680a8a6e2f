"""Draw what moves the results of the study most.

Inputs: sweep.csv. Outputs: a PNG and an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(table: Path, png: Path, svg: Path, *, note: str | None) -> None:
    figures.save_figure(figures.sweep_figure(read_table(table), source_note=note), png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.table),
            Path(snakemake.output.sweep),
            Path(snakemake.output.sweep_svg),
            note=snakemake.params.note,
        )
