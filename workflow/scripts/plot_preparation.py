"""Draw what was done to the scans of every patch.

Inputs: the patches' surfaces. Outputs: a folder with a PNG and an SVG for each patch. Settings: the
patches, those with a T1, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log, patch_by_patch


def main(surfaces: dict[str, dict[str, Path]], folder: Path, *, note: str | None) -> None:
    """`surfaces` maps each patch to its epochs' files."""
    for patch, files in patch_by_patch(surfaces):
        prepared = {epoch: read_dataset(file) for epoch, file in files.items()}
        measured = {epoch: surface.measured for epoch, surface in prepared.items()}
        figure = figures.preparation_figure(prepared, measured, patch=patch, source_note=note)
        figures.save_figure(figure, folder / f"{patch}.png", folder / f"{patch}.svg")


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        surfaces = {
            patch: {"T0": Path(file)}
            for patch, file in zip(snakemake.params.patches, snakemake.input.t0, strict=True)
        }
        for patch, file in zip(snakemake.params.worn, snakemake.input.t1, strict=True):
            surfaces[patch]["T1"] = Path(file)
        main(surfaces, Path(snakemake.output.preparation), note=snakemake.params.note)
