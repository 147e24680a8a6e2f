"""Draw where every patch sticks and slips.

Inputs: the patches' contacts, the folder of their slip files. Outputs: a PNG and an SVG. Settings:
the patches, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log


def main(
    contacts: dict[str, Path], slips: dict[str, Path], png: Path, svg: Path, *, note: str | None
) -> None:
    figure = figures.slip_figure(
        {patch: read_dataset(file, only=["height"]).height for patch, file in contacts.items()},
        {patch: read_dataset(file) for patch, file in slips.items()},
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            {patch: Path(snakemake.input.slips) / f"{patch}.h5" for patch in ids},
            Path(snakemake.output.slip),
            Path(snakemake.output.slip_svg),
            note=snakemake.params.note,
        )
