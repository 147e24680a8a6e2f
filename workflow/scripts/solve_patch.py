"""Press a patch, step by step, up to its own pressure: against a flat, or against a counterface.

Inputs: the patch's T0 surface; the counterface's, if there is one. Outputs: contact HDF5 (the final
state and the load path). Settings: contact modulus, the patch's pressure, number of steps,
tolerance, largest displacement.
"""

from pathlib import Path

from gstlib.contact import contact_dataset, pressed_height, solve_path
from gstlib.counterface import turned_over
from gstlib.io.store import read_dataset, write_dataset
from gstlib.logs import job_log
from gstlib.provenance import provenance


def main(
    surface: Path, counterface: Path | None, contact: Path, *, threads: int, **settings: float
) -> None:
    faces = read_dataset(surface, only=["height"])
    if counterface is not None:
        faces["counterface"] = turned_over(
            read_dataset(counterface, only=["height"]).height,
            faces.height,
            source=counterface,
            patch_source=surface,
        )
    solved = solve_path(
        pressed_height(faces), source=surface, keep_states=False, workers=threads, **settings
    )
    dataset = contact_dataset(faces.height, solved, every_step=False)
    if counterface is not None:
        dataset["counterface"] = faces.counterface
    inputs = [surface] if counterface is None else [surface, counterface]
    write_dataset(contact, dataset, settings | provenance(inputs, settings))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        counterface = snakemake.input.get("counterface")
        main(
            Path(snakemake.input.surface),
            Path(counterface) if counterface else None,
            Path(snakemake.output.contact),
            threads=snakemake.threads,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            steps=snakemake.params.steps,
            tolerance=snakemake.params.tolerance,
            maximum_displacement_um=snakemake.params.maximum_displacement_um,
        )
