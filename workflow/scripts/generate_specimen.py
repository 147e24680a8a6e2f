"""Generate the synthetic specimen: mesh, scans and truth, or its mesh alone without patches."""

from pathlib import Path

import pandas as pd

from gst.run.logs import run_in_snakemake
from gstlib.io.files import write_whole
from gstlib.specimen.generate import (
    counterface_stl,
    make_specimen,
    stone_stl,
    write_specimen,
)
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import Stone


def main(
    mesh: Path,
    scans: list[Path],
    truth: Path | None = None,
    surface: Path | None = None,
    counterface: Path | None = None,
    *,
    patches: dict[str, list],
    specimen: dict,
    square_mm: float,
    grid: int,
    around: int,
) -> None:
    parameters = SpecimenParameters(**specimen)
    if counterface is not None:
        write_whole(counterface, counterface_stl(parameters, square_mm))
    if truth is None:
        write_whole(mesh, stone_stl(Stone(parameters, square_mm)))
        return
    sizes = {"square_mm": square_mm, "grid": grid, "around": around}
    made = make_specimen(pd.DataFrame(patches), parameters, **sizes)
    write_specimen(
        made, mesh=mesh, scan_folder=scans[0].parent, truth=truth, surface=surface
    )


run_in_snakemake(main)
