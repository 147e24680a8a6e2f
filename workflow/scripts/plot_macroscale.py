"""Draw the square: contact as the load grows, curves, forces, patch pressures.

Inputs: contact.h5 of the macroscale, patch_pressures.csv, patch_intervals.csv. Outputs: a PNG and
an SVG each. Settings: patch side, a note on the source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(
    contact: Path,
    pressures: Path,
    intervals: Path,
    output: dict[str, Path],
    *,
    patch_mm: float,
    note: str | None,
) -> None:
    """`output` maps the name of each figure to its PNG, and ``<name>_svg`` to its SVG."""
    solved = read_dataset(contact)
    table = read_table(pressures, ["patch", "x_mm", "y_mm", "pressure_MPa", "in_study"])
    limits = read_table(intervals, ["patch", "low_MPa", "high_MPa"])
    bounded = table.merge(limits[["patch", "low_MPa", "high_MPa"]], on="patch")
    drawn = {
        "contact_steps": figures.contact_steps_figure(solved, source_note=note),
        "elastic_rigid": figures.elastic_rigid_figure(solved, source_note=note),
        "macroscale_curves": figures.macroscale_curves_figure(solved, source_note=note),
        "forces": figures.force_figure(solved, table, patch_size_mm=patch_mm, source_note=note),
        "patch_pressures": figures.patch_pressure_figure(bounded, source_note=note),
    }
    for name, figure in drawn.items():
        figures.save_figure(figure, output[name], output[f"{name}_svg"])


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.contact),
            Path(snakemake.input.pressures),
            Path(snakemake.input.intervals),
            {name: Path(file) for name, file in snakemake.output.items()},
            patch_mm=snakemake.params.patch_mm,
            note=snakemake.params.note,
        )
