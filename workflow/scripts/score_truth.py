"""Score every stage against the generated specimen's truth.

Inputs: truth.h5, surface.h5 of the macroscale, placement.csv, patch_pressures.csv, prepared and
registered scans.
Outputs: truth.csv. Settings: patches, those with a T1, patch side; contact modulus, target
pressure and tolerance of the macroscale.
"""

from pathlib import Path

import pandas as pd
import xarray as xr

from gstlib.contact import solve_at_pressure
from gstlib.coupling import patch_pressures
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.preprocess.leveling import remove_plane
from gstlib.specimen import true_patches, true_surface
from gstlib.specimen.score import score_truth


def true_pressures(
    truth: xr.Dataset,
    *,
    patch_mm: float,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    tolerance: float,
    threads: int,
) -> pd.Series:
    """Pressure (MPa) that the true surface puts on each patch at its true place."""
    height, _ = remove_plane(true_surface(truth))
    _, pressure = solve_at_pressure(
        height,
        source="the true macroscale surface",
        contact_modulus_MPa=contact_modulus_MPa,
        target_pressure_MPa=target_pressure_MPa,
        tolerance=tolerance,
        workers=threads,
    )
    table = patch_pressures(pressure, true_patches(truth), size_mm=patch_mm)
    return table.set_index("patch").pressure_MPa


def main(
    truth: Path,
    surface: Path,
    surfaces: dict[tuple[str, str], Path],
    registered: dict[str, Path],
    placement: Path,
    pressures: Path,
    table: Path,
    **settings: float,
) -> None:
    known = read_dataset(truth)
    scores = score_truth(
        known,
        macroscale=surface,
        surfaces=surfaces,
        registered=registered,
        placement=placement,
        patch_pressures=pressures,
        true_pressures=true_pressures(known, **settings),
    )
    write_table(table, scores)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        patches, worn = snakemake.params.patches, snakemake.params.worn
        scans = [(patch, "T0") for patch in patches] + [(patch, "T1") for patch in worn]
        main(
            Path(snakemake.input.truth),
            Path(snakemake.input.surface),
            dict(zip(scans, map(Path, snakemake.input.surfaces), strict=True)),
            dict(zip(worn, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.placement),
            Path(snakemake.input.pressures),
            Path(snakemake.output.table),
            patch_mm=snakemake.params.patch_mm,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            tolerance=snakemake.params.tolerance,
            threads=snakemake.threads,
        )
