"""Draw the scores of every patch beside its rival's, and wear against pressure over the patches.

Inputs: validation_patches.csv, validation_summary.csv, microscale_summary.csv. Outputs: a PNG and
an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(
    patches: Path, summary: Path, microscale: Path, png: Path, svg: Path, *, note: str | None
) -> None:
    figure = figures.validation_figure(
        read_table(patches), read_table(summary), read_table(microscale), source_note=note
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.patches),
            Path(snakemake.input.summary),
            Path(snakemake.input.microscale),
            Path(snakemake.output.validation),
            Path(snakemake.output.validation_svg),
            note=snakemake.params.note,
        )
