"""Draw the study at a glance: the square in contact, forces, the hardest pressed patch.

Inputs: contact.h5 of the macroscale, patch_pressures.csv, the patch's contact and, if there is a
T1, its height change. Outputs: a PNG and an SVG. Settings: the patch, patch side, a note on the
source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(
    macroscale: Path,
    pressures: Path,
    contact: Path,
    registered: Path | None,
    png: Path,
    svg: Path,
    *,
    patch: str,
    patch_mm: float,
    note: str | None,
) -> None:
    figure = figures.overview_figure(
        read_dataset(macroscale),
        read_table(pressures, ["patch", "x_mm", "y_mm", "pressure_MPa", "in_study"]),
        read_dataset(contact),
        None if registered is None else read_dataset(registered),
        patch=patch,
        patch_size_mm=patch_mm,
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        registered = snakemake.input.get("registered")
        main(
            Path(snakemake.input.macroscale),
            Path(snakemake.input.pressures),
            Path(snakemake.input.contact),
            Path(registered) if registered else None,
            Path(snakemake.output.overview),
            Path(snakemake.output.overview_svg),
            patch=snakemake.params.patch,
            patch_mm=snakemake.params.patch_mm,
            note=snakemake.params.note,
        )
