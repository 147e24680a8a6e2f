"""Press the paper's square alone, on its mean plane."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Loading, contact_at_pressure
from gstlib.io.store import read_dataset, write_dataset
from gstlib.macroscale.face import square_alone


def main(
    face: Path, contact: Path, *, force_N: float, contact_modulus_MPa: float, tolerance: float
) -> None:
    square = square_alone(read_dataset(face, only=["height", "size_mm"]))
    pressed = {"contact_modulus_MPa": contact_modulus_MPa, "tolerance": tolerance}
    loading = Loading.by_force(force_N, None, square.height, **pressed)
    solved = contact_at_pressure(square, loading, source=face)
    write_dataset(contact, solved, provenance([face], loading._asdict()))


if "snakemake" in globals():
    run_script(snakemake, main)
