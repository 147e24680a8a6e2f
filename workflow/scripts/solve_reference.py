"""Solve the contact of the whole square at the resolution of the scans, for each realisation."""

from pathlib import Path

from gst.run.batches import files_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import contact_of
from gst.run.writing import write_result
from gstlib.io.store import Stored, read_dataset
from gstlib.specimen.score import true_contact
from gstlib.validation.single_scale import drawn_surfaces, solve_realisations


def main(
    face: Path,
    composite: Path,
    macroscale: Path,
    t0: list[Path],
    true_surface: Path,
    truth: Path,
    contact: Path,
    patches: Path,
    *,
    drawn: dict,
) -> None:
    mesh, around = read_dataset(face), contact_of(macroscale)
    lying = read_dataset(truth).sel(epoch="T0") if truth else read_dataset(composite)
    scans = Stored(files_of(t0, lying.patch.values), ["height"])
    if truth:
        around = true_contact(lying, mesh.counterface, around, source=truth)
        surfaces = [read_dataset(true_surface).height.astype(float)]
    else:
        surfaces = drawn_surfaces(mesh, lying, scans, **drawn)
    whole, on_patches = solve_realisations(
        surfaces, around, lying, scans, source=true_surface or face
    )
    for file, fields in ((contact, whole), (patches, on_patches)):
        write_result(file, fields, "solve_reference")


run_in_snakemake(main)
