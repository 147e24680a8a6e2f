"""Solve the contact of the paper's square alone, on its mean plane."""

from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, write_result
from gstlib.macroscale.equilibrium import solve_at_load


def main(face: Path, contact: Path, **settings: float) -> None:
    """`settings` are arguments of `solve_at_load`."""
    square = dataset_of(face, ["height", "size_mm"])
    solved = solve_at_load(square, source=face, **settings)
    write_result(contact, solved.to_dataset(), "solve_square")


run_in_snakemake(main)
