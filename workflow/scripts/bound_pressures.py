"""Compute intervals of the patch pressures from the errors of mesh, positions and constants."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import active_tool_of, dataset_of
from gstlib.coupling.intervals import Errors, Macroscale, pressure_intervals
from gstlib.io.tables import read_pressures


def main(
    face: Path,
    composite: Path | list,
    second: Path | list,
    use: Path | list,
    pressures: Path,
    table: Path,
    *,
    uncertainty: dict[str, float],
    material: dict[str, float],
    load: dict,
    radius_mm: float | None,
    patch_mm: float,
    seed: int,
) -> None:
    pressed = dataset_of(face), dataset_of(composite), active_tool_of(second)
    macroscale = Macroscale(*pressed, radius_mm, dataset_of(use))
    limits = pressure_intervals(
        macroscale,
        read_pressures(pressures),
        material,
        Errors(**uncertainty),
        **load,
        patch_mm=patch_mm,
        seed=seed,
    )
    write_table(table, limits)


run_in_snakemake(main)
