"""Draw figures of the study from stored results: those whose pictures the rule names."""

import math
from pathlib import Path

from gst.page.figures.study import draw
from gst.page.results import Results
from gst.run.logs import run_script

PICTURES = "_png", "_svg", "_pdf", "_jpg"


def main(
    *,
    patches: list[str] | tuple = (),
    worn: list[str] | tuple = (),
    max_plotted_patches: int = 0,
    places: dict[str, list] | None = None,
    size_mm: float = math.nan,
    patch_mm: float = math.nan,
    force_N: float = math.nan,
    mesh_unit: str = "mm",
    note: str | None,
    **files: Path | list[Path],
) -> None:
    """`files` are those that the figures show, and their pictures (see `draw`)."""
    pictures = {name: file for name, file in files.items() if name.endswith(PICTURES)}
    shown = patches, worn, max_plotted_patches
    study = Results(files, *shown, places, size_mm, patch_mm, force_N, mesh_unit)
    draw(study, pictures, note)


if "snakemake" in globals():
    run_script(snakemake, main)
