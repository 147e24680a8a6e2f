"""Solve the contact of the whole square at the resolution of the scans, for each realisation."""

from pathlib import Path

from gst.run.contacts import contact_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, scans_of, write_result
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
    mesh, around = dataset_of(face), contact_of(macroscale)
    lying = dataset_of(truth).sel(epoch="T0") if truth else dataset_of(composite)
    scans = scans_of(t0, lying.patch.values)
    if truth:
        around = true_contact(lying, mesh.counterface, around, source=truth)
        surfaces = [dataset_of(true_surface).height.astype(float)]
    else:
        surfaces = drawn_surfaces(mesh, lying, scans, **drawn)
    whole, on_patches = solve_realisations(
        surfaces, around, lying, scans, source=true_surface or face
    )
    for file, fields in ((contact, whole), (patches, on_patches)):
        write_result(file, fields, "solve_reference")


run_in_snakemake(main)
