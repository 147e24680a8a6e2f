"""Make the generated specimen: its mesh, its scans before and after use, and the truth."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gstlib.io.files import write_whole
from gstlib.specimen.generate import counterface_stl, make_specimen, write_specimen
from gstlib.specimen.randomness import SpecimenParameters


def main(
    table: Path,
    mesh: Path,
    scans: list[Path],
    truth: Path,
    surface: Path,
    counterface: Path | None = None,
    *,
    patches: dict[str, list],
    specimen: dict,
    square_mm: float,
    grid: int,
) -> None:
    parameters = SpecimenParameters(**specimen)
    if counterface is not None:
        write_whole(counterface, counterface_stl(parameters, square_mm))
    made = make_specimen(pd.DataFrame(patches), parameters, square_mm=square_mm, grid=grid)
    write_specimen(made, mesh=mesh, scan_folder=scans[0].parent, truth=truth, surface=surface)


if "snakemake" in globals():
    run_script(snakemake, main)
