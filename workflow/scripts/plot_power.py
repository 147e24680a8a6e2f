"""Draw how often each test claims a relation, where there is one and where there is none.

Inputs: power.csv. Outputs: a PNG and an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(rates: Path, png: Path, svg: Path, *, note: str | None) -> None:
    columns = ["test", "drawn", "wear", "level", "specimens", "rate", "low", "high"]
    figure = figures.power_figure(read_table(rates, columns), source_note=note)
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.rates),
            Path(snakemake.output.power),
            Path(snakemake.output.power_svg),
            note=snakemake.params.note,
        )
