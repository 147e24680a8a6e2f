"""Draw what a ceiling on the pressure does to every patch's contact.

Inputs: the patches' contacts, the folder of those with the ceiling. Outputs: a PNG and an SVG.
Settings: the patches, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log


def main(
    contacts: dict[str, Path], limited: dict[str, Path], png: Path, svg: Path, *, note: str | None
) -> None:
    figure = figures.hardness_figure(
        {
            patch: read_dataset(file, only=["height", "pressure"])
            for patch, file in contacts.items()
        },
        {patch: read_dataset(file) for patch, file in limited.items()},
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            {patch: Path(snakemake.input.limited) / f"{patch}.h5" for patch in ids},
            Path(snakemake.output.hardness),
            Path(snakemake.output.hardness_svg),
            note=snakemake.params.note,
        )
