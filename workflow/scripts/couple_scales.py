"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.tables import write_table
from gstlib.contact import Loading, contact_at_pressure
from gstlib.coupling.pressures import couple_scales
from gstlib.io.store import read_dataset
from gstlib.macroscale.face import square_alone


def main(
    face: Path,
    contact: Path,
    pressures: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
    force_N: float,
    **pressed: float,
) -> None:
    square = square_alone(read_dataset(face, only=["height", "size_mm"]))
    loading = Loading.by_force(force_N, None, square.height, **pressed)
    alone = contact_at_pressure(square, loading, source=face)
    whole = read_dataset(contact, only=["pressure"])
    table = couple_scales(whole, alone, pd.DataFrame(patches), patch_mm=patch_mm)
    write_table(pressures, table)


if "snakemake" in globals():
    run_script(snakemake, main)
