"""Press the stone step by step up to its load: the face at rest, or the paper's square alone."""

import logging
from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Loading, contact_path, faces_of
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.macroscale.equilibrium import macroscale_table
from gstlib.macroscale.face import square_alone
from gstlib.macroscale.plausibility import contact_doubts


def main(
    face: Path,
    contact: Path,
    path: Path,
    *,
    force_N: float,
    through: tuple[float, float] | None,
    contact_modulus_MPa: float,
    tolerance: float,
    patch_mm: float,
    steps: int,
    maximum_displacement_um: float,
) -> None:
    whole = read_dataset(face, only=["height", "counterface", "size_mm"])
    pressed = {"contact_modulus_MPa": contact_modulus_MPa, "tolerance": tolerance}
    rests = through is not None
    faces = faces_of(whole.height, whole.counterface) if rests else square_alone(whole)
    loading = Loading.by_force(force_N, through, faces.height, **pressed)
    settings = {"steps": steps, "maximum_displacement_um": maximum_displacement_um}
    solved = contact_path(faces, loading, source=face, every_step=True, **settings)
    write_dataset(contact, solved, provenance([face], loading._asdict() | settings))
    write_table(path, macroscale_table(solved))
    for doubt in contact_doubts(solved, size_mm=float(whole.size_mm), patch_mm=patch_mm):
        logging.getLogger("gstlib").warning("%s", doubt)


if "snakemake" in globals():
    run_script(snakemake, main)
