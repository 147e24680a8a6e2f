"""Draw where each patch was found on the square.

Inputs: surface.h5 of the macroscale, placement.csv, placement.h5. Outputs: a PNG and an SVG.
Settings: the patch table, patch side, a note on the source.
"""

from pathlib import Path

import pandas as pd

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.logs import job_log


def main(
    surface: Path,
    placement: Path,
    maps: Path,
    png: Path,
    svg: Path,
    *,
    patches: pd.DataFrame,
    patch_mm: float,
    note: str | None,
) -> None:
    figure = figures.placement_figure(
        read_dataset(surface).height,
        patches,
        read_table(placement, ["patch", "shift_x_um", "shift_y_um", "verdict", "looks"]),
        read_dataset(maps),
        patch_size_mm=patch_mm,
        source_note=note,
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.surface),
            Path(snakemake.input.placement),
            Path(snakemake.input.maps),
            Path(snakemake.output.placement),
            Path(snakemake.output.placement_svg),
            patches=pd.DataFrame(snakemake.params.patches),
            patch_mm=snakemake.params.patch_mm,
            note=snakemake.params.note,
        )
