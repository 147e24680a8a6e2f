"""Draw what was done to a patch's scans.

Inputs: the patch's prepared surfaces. Outputs: a PNG and an SVG. Settings: the epochs, a note on
the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log


def main(surfaces: dict[str, Path], png: Path, svg: Path, *, patch: str, note: str | None) -> None:
    prepared = {epoch: read_dataset(file) for epoch, file in surfaces.items()}
    measured = {epoch: surface.measured for epoch, surface in prepared.items()}
    figure = figures.preparation_figure(prepared, measured, patch=patch, source_note=note)
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.epochs, map(Path, snakemake.input.surfaces), strict=True)),
            Path(snakemake.output.preparation),
            Path(snakemake.output.preparation_svg),
            patch=snakemake.wildcards.patch,
            note=snakemake.params.note,
        )
