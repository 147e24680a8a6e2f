"""Lay T1 over T0, patch by patch, and take the height change.

Inputs: the surfaces at T0 and T1. Outputs: a file with T1, change, loss and gain for each patch.
Settings: the patches, farthest shift, least points of a trace.
"""

import logging
from pathlib import Path

from gstlib.errors import InputError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.logs import job_log, patch_by_patch
from gstlib.provenance import provenance
from gstlib.validation.change import measured_change


def lay_over(
    patch: str,
    t0: Path,
    t1: Path,
    registered: Path,
    *,
    maximum_shift_mm: float,
    minimum_points: int,
) -> None:
    """Register T1 to T0 and store the height change."""
    before, after = (read_dataset(file, only=["height", "filled", "outlier"]) for file in (t0, t1))
    settings = {"maximum_shift_mm": maximum_shift_mm, "minimum_points": minimum_points}
    registration, change = measured_change(before, after, **settings)
    if registration.found and not change.attrs["known_share"]:
        logging.getLogger("gstlib").warning(
            "patch %s: hardly any point has a height of its own at T0 and at T1 (%.0f %% and "
            "%.0f %% of the scans are holes or outliers, T1 covers %.0f %% of T0): nothing is said "
            "of its wear. Scan it again, or leave its t1 empty.",
            patch,
            *(100 * (epoch.filled | epoch.outlier).values.mean() for epoch in (before, after)),
            100 * registration.overlap,
        )
    write_dataset(registered, change, registration.as_attrs() | provenance([t0, t1], settings))


def main(files: dict[str, tuple[Path, Path, Path]], **settings: float) -> None:
    for patch, paths in patch_by_patch(files):
        try:
            lay_over(patch, *paths, **settings)
        except InputError as error:  # it names the epoch, but not the patch
            source = f"patch {patch}, {error.source}"
            raise InputError(source, error.problem, error.remedy) from error


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        paths = zip(
            map(Path, snakemake.input.t0),
            map(Path, snakemake.input.t1),
            map(Path, snakemake.output.registered),
            strict=True,
        )
        main(
            dict(zip(snakemake.params.patches, paths, strict=True)),
            maximum_shift_mm=snakemake.params.maximum_shift_mm,
            minimum_points=snakemake.params.minimum_points,
        )
