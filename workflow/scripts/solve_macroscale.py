"""Press the square against a flat, step by step, up to the target mean pressure.

Inputs: surface.h5. Outputs: contact.h5 (every step's pressure and gap), macroscale_path.csv.
Settings: contact modulus, target pressure, number of steps, tolerance, largest displacement.
"""

from pathlib import Path

from gstlib.contact import contact_dataset, load_path_table, solve_path
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.provenance import provenance


def main(
    surface: Path,
    contact: Path,
    path: Path,
    *,
    threads: int,
    **settings: float,
) -> None:
    height = read_dataset(surface).height
    solved = solve_path(height, source=surface, keep_states=True, workers=threads, **settings)
    dataset = contact_dataset(height, solved, every_step=True)
    write_dataset(contact, dataset, settings | provenance([surface], settings))
    write_table(path, load_path_table(dataset))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.surface),
            Path(snakemake.output.contact),
            Path(snakemake.output.path),
            threads=snakemake.threads,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            target_pressure_MPa=snakemake.params.target_pressure_MPa,
            steps=snakemake.params.steps,
            tolerance=snakemake.params.tolerance,
            maximum_displacement_um=snakemake.params.maximum_displacement_um,
        )
