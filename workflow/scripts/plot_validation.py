"""Draw what was predicted and measured on every patch, with its scores beside chance and rivals.

Inputs: the patches' contacts and registered height changes, the validation tables. Outputs: a PNG
and an SVG. Settings: the patches, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(
    contacts: dict[str, Path],
    registered: dict[str, Path],
    patches: Path,
    gains: Path,
    failures: Path,
    summary: Path,
    png: Path,
    svg: Path,
    *,
    note: str | None,
) -> None:
    predicted = ["height", "pressure", "mean_pressure"]
    figure = figures.validation_figure(
        {patch: read_dataset(file, only=predicted) for patch, file in contacts.items()},
        {patch: read_dataset(file, only=["change", "loss"]) for patch, file in registered.items()},
        *(read_table(table) for table in (patches, gains, failures, summary)),
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            dict(zip(ids, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.patches),
            Path(snakemake.input.gains),
            Path(snakemake.input.failures),
            Path(snakemake.input.summary),
            Path(snakemake.output.validation),
            Path(snakemake.output.validation_svg),
            note=snakemake.params.note,
        )
