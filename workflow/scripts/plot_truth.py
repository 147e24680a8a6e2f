"""Draw what the stages recovered against the generated specimen's truth.

Inputs: truth.csv. Outputs: a PNG and an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(truth: Path, png: Path, svg: Path, *, note: str | None) -> None:
    table = read_table(truth, ["stage", "quantity", "patch", "unit", "true", "recovered"])
    figures.save_figure(figures.truth_figure(table, source_note=note), png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.truth),
            Path(snakemake.output.truth),
            Path(snakemake.output.truth_svg),
            note=snakemake.params.note,
        )
