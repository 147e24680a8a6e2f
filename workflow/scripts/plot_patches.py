"""Draw every patch before use, the contact predicted on it, and after use.

Inputs: the patches' contacts, their registered height changes. Outputs: a folder with a PNG and an
SVG for each patch. Settings: the patches, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log, patch_by_patch


def main(
    contacts: dict[str, Path], registered: dict[str, Path], folder: Path, *, note: str | None
) -> None:
    for patch, contact in patch_by_patch(contacts):
        figure = figures.patch_figure(
            read_dataset(contact), read_dataset(registered[patch]), patch=patch, source_note=note
        )
        figures.save_figure(figure, folder / f"{patch}.png", folder / f"{patch}.svg")


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            dict(zip(ids, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.output.patch),
            note=snakemake.params.note,
        )
