"""Press the square against a flat, step by step, up to the target pressure."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import load_path_table
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.study import solve_macroscale


def main(surface: Path, contact: Path, path: Path, **settings: float) -> None:
    solved = solve_macroscale(read_dataset(surface), source=surface, **settings)
    write_dataset(contact, solved, provenance([surface], settings))
    write_table(path, load_path_table(solved))


if "snakemake" in globals():
    run_script(snakemake, main)
