"""Make the generated specimen: its mesh, its scans before and after use, and the truth."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gstlib.specimen.generate import generate_specimen
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
    **settings,
) -> None:
    generate_specimen(
        pd.DataFrame(patches),
        mesh=mesh,
        scan_folder=scans[0].parent,
        truth=truth,
        surface=surface,
        counterface=counterface,
        parameters=SpecimenParameters(**specimen),
        **settings,
    )


if "snakemake" in globals():
    run_script(snakemake, main)
