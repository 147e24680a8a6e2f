"""Say how sure the pressure of each patch is, given the errors of mesh, places and constants."""

from pathlib import Path

from gst.logs import run_script
from gst.tables import write_table
from gstlib.coupling.intervals import Errors, Macroscale, pressure_intervals
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures


def main(
    face: Path,
    composite: Path,
    second: Path,
    use: Path,
    pressures: Path,
    table: Path,
    *,
    uncertainty: dict[str, float],
    material: dict[str, float],
    force_N: float,
    through: tuple[float, float] | None,
    radius_mm: float | None,
    patch_mm: float,
    seed: int,
) -> None:
    macroscale = Macroscale(
        read_dataset(face),
        read_dataset(composite) if composite else None,
        read_dataset(second).face if second else None,
        radius_mm,
        read_dataset(use) if use else None,
    )
    load = {"force_N": force_N, "through": through}
    errors, given = Errors(**uncertainty), read_pressures(pressures)
    limits = pressure_intervals(
        macroscale, given, material, errors, **load, patch_mm=patch_mm, seed=seed
    )
    write_table(table, limits)


if "snakemake" in globals():
    run_script(snakemake, main)
