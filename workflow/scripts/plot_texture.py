"""Draw the texture of every patch before and after use.

Inputs: texture.csv. Outputs: a PNG and an SVG. Settings: a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(texture: Path, png: Path, svg: Path, *, note: str | None) -> None:
    table = read_table(
        texture, ["patch", "epoch", "Sq_um", "Sk_um", "Spk_um", "Svk_um", "Sal_um", "Str"]
    )
    figures.save_figure(figures.texture_figure(table, source_note=note), png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.texture),
            Path(snakemake.output.texture),
            Path(snakemake.output.texture_svg),
            note=snakemake.params.note,
        )
