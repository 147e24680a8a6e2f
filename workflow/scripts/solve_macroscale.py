"""Press the square against a flat, or a second stone, step by step up to the target pressure."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Loading, contact_path, faces_of, load_path_table
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table


def main(
    square: Path,
    contact: Path,
    path: Path,
    *,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    tolerance: float,
    **settings: float,
) -> None:
    whole = read_dataset(square, only=["height", "counterface"])
    loading = Loading(contact_modulus_MPa, target_pressure_MPa, tolerance)
    faces = faces_of(whole.height, whole.counterface)
    solved = contact_path(faces, loading, source=square, every_step=True, **settings)
    write_dataset(contact, solved, provenance([square], loading._asdict() | settings))
    write_table(path, load_path_table(solved))


if "snakemake" in globals():
    run_script(snakemake, main)
