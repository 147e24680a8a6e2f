"""Draw the published figures beside the computed ones.

Inputs: published.csv. Outputs: a PNG and an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(published: Path, png: Path, svg: Path, *, note: str | None) -> None:
    columns = ["quantity", "patch", "unit", "published", "computed"]
    figure = figures.published_figure(read_table(published, columns), source_note=note)
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.published),
            Path(snakemake.output.published),
            Path(snakemake.output.published_svg),
            note=snakemake.params.note,
        )
