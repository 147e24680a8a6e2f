"""Sum the macroscale forces over each patch."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gstlib.contact import Loading, contact_at_pressure, faces_of
from gstlib.coupling import couple_scales
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table


def main(
    square: Path,
    contact: Path,
    pressures: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
    **loading: float,
) -> None:
    mesh = read_dataset(square, only=["height", "counterface"])
    faces = faces_of(mesh.height, mesh.counterface)
    alone = contact_at_pressure(faces, Loading(**loading), source=square)
    whole = read_dataset(contact, only=["pressure"])
    table = couple_scales(whole, alone, pd.DataFrame(patches), patch_mm=patch_mm)
    write_table(pressures, table)


if "snakemake" in globals():
    run_script(snakemake, main)
