"""Draw a patch before use, the contact predicted on it, and after use.

Inputs: its contact, its registered height change. Outputs: a PNG and an SVG. Settings: a note on
the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log


def main(
    contact: Path, registered: Path, png: Path, svg: Path, *, patch: str, note: str | None
) -> None:
    figure = figures.patch_figure(
        read_dataset(contact), read_dataset(registered), patch=patch, source_note=note
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.contact),
            Path(snakemake.input.registered),
            Path(snakemake.output.patch),
            Path(snakemake.output.patch_svg),
            patch=snakemake.wildcards.patch,
            note=snakemake.params.note,
        )
