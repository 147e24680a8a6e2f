"""Lay T1 over T0, patch by patch, and take the height change.

Inputs: the surfaces at T0 and T1. Outputs: a file with T1, change and loss for each patch.
Settings: the patches, farthest shift.
"""

import logging
from pathlib import Path

from gstlib.errors import InputError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.logs import job_log
from gstlib.provenance import provenance
from gstlib.validation.change import height_change
from gstlib.validation.registration import apply_registration, register


def lay_over(t0: Path, t1: Path, registered: Path, *, maximum_shift_mm: float) -> None:
    """Register T1 to T0 and store the height change."""
    before, after = (read_dataset(file, only=["height"]).height for file in (t0, t1))
    registration = register(before, after, maximum_shift_mm=maximum_shift_mm)
    change = height_change(before, apply_registration(after, registration, like=before))
    settings = {"maximum_shift_mm": maximum_shift_mm}
    write_dataset(registered, change, registration.as_attrs() | provenance([t0, t1], settings))


def main(files: dict[str, tuple[Path, Path, Path]], *, maximum_shift_mm: float) -> None:
    for patch, (t0, t1, registered) in files.items():
        logging.getLogger("gstlib").info("patch %s", patch)
        try:
            lay_over(t0, t1, registered, maximum_shift_mm=maximum_shift_mm)
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
        )
