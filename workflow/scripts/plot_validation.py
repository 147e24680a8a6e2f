"""Draw what was predicted and measured on every patch, with its scores beside chance and rivals.

Inputs: the drawn patches' contacts and registered height changes, the tables of all. Outputs: a PNG
and an SVG. Settings: the patches, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.logs import job_log

# What is drawn of each table.
COLUMNS = {
    "patches": ["patch", "loss_fraction"],
    "gains": ["patch", "score", "value", "null_low", "null_high", "p_value"],
    "failures": ["split", "band", "area_share", "loss_share", "hit_share"],
    "summary": ["statistic", "value", "low", "high", "p_value", "against"],
}


def main(
    contacts: dict[str, Path],
    registered: dict[str, Path],
    microscale: Path,
    tables: dict[str, Path],
    png: Path,
    svg: Path,
    *,
    note: str | None,
) -> None:
    predicted = ["height", "pressure", "mean_pressure"]
    figure = figures.validation_figure(
        {patch: read_dataset(file, only=predicted) for patch, file in contacts.items()},
        {patch: read_dataset(file, only=["change", "loss"]) for patch, file in registered.items()},
        *(read_table(tables[name], columns) for name, columns in COLUMNS.items()),
        pressures=read_table(microscale, ["patch", "mean_pressure_MPa"])
        .set_index("patch")
        .mean_pressure_MPa.to_dict(),
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            dict(zip(ids, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.microscale),
            {name: Path(snakemake.input[name]) for name in COLUMNS},
            Path(snakemake.output.validation),
            Path(snakemake.output.validation_svg),
            note=snakemake.params.note,
        )
