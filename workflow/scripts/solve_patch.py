"""Press a patch against a flat, step by step, up to its own pressure.

Inputs: the patch's T0 surface. Outputs: contact HDF5 (the final state and the load path).
Settings: contact modulus, the patch's pressure, number of steps, tolerance, largest displacement.
"""

from pathlib import Path

from gstlib.contact import contact_dataset, solve_path
from gstlib.io.store import read_dataset, write_dataset
from gstlib.logs import job_log
from gstlib.provenance import provenance


def main(surface: Path, contact: Path, *, threads: int, **settings: float) -> None:
    height = read_dataset(surface).height
    solved = solve_path(height, source=surface, keep_states=False, workers=threads, **settings)
    dataset = contact_dataset(height, solved, every_step=False)
    write_dataset(contact, dataset, settings | provenance([surface], settings))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.surface),
            Path(snakemake.output.contact),
            threads=snakemake.threads,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            steps=snakemake.params.steps,
            tolerance=snakemake.params.tolerance,
            maximum_displacement_um=snakemake.params.maximum_displacement_um,
        )
