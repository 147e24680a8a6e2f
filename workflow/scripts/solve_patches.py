"""Solve the contact of each patch of a batch at its own pressure, in each coupling variant."""

from pathlib import Path

from gst.run.contacts import contact_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, scans_of, write_result
from gstlib.io.tables import read_pressures
from gstlib.microscale.patches import Microscale, solve_patches


def main(
    t0: list[Path],
    counterface: Path,
    pressures: Path,
    composite: Path,
    contact: Path,
    contacts: Path,
    others: Path | None = None,
    *,
    patches: list[str],
    variants: list[str],
    microscale: dict[str, float],
) -> None:
    around = {"counterface": dataset_of(counterface).height} if counterface else {}
    if composite:
        around |= {"composite": dataset_of(composite), "contact": contact_of(contact)}
    folders = dict(zip(variants, [contacts, others], strict=False))
    solved = solve_patches(
        scans_of(t0, patches),
        read_pressures(pressures),
        Microscale(**microscale),
        variants=variants,
        **around,
    )
    for patch, variant, pressed in solved:
        file = folders[variant] / f"{patch}.h5"
        write_result(file, pressed.to_dataset(), "solve_patches")


run_in_snakemake(main)
