"""Solve the contact of the stone step by step: the face at rest, or the paper's square alone."""

import logging
from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, face_of, write_result
from gstlib.contact import contact_path
from gstlib.macroscale.equilibrium import face_under_load, macroscale_table
from gstlib.macroscale.plausibility import plausibility_warnings
from gstlib.use.outcome import as_used


def main(
    face: Path,
    use: Path | list,
    contact: Path,
    path: Path,
    *,
    force_N: float,
    load_point: tuple[float, float] | None,
    modulus: float,
    solving: dict[str, float],
    patch_mm: float,
) -> None:
    whole, load_point = as_used(face_of(face), dataset_of(use), load_point)
    pressed = face_under_load(whole, force_N, load_point)
    solved = contact_path(
        *pressed, source=face, modulus=modulus, every_step=True, **solving
    )
    stored, size_mm = solved.to_dataset(), float(whole.size_mm)
    write_result(contact, stored, "solve_macroscale")
    write_table(path, macroscale_table(stored))
    for doubt in plausibility_warnings(
        solved.final, size_mm=size_mm, patch_mm=patch_mm
    ):
        logging.getLogger("gstlib").warning("%s", doubt)


run_in_snakemake(main)
