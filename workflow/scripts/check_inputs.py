"""Read every file of the study once, before any work, and draw where the patches lie.

Inputs: the mesh, every scan. Outputs: inputs.csv, a PNG and an SVG of the square with its patches.
Settings: the patch table, the files by patch and epoch, sections of the config, a note on the
source.
"""

from pathlib import Path

import pandas as pd

from gstlib import figures
from gstlib.inputs import ScanFile, check_inputs
from gstlib.io.tables import write_table
from gstlib.logs import job_log


def main(
    mesh: Path,
    scans: list[ScanFile],
    patches: pd.DataFrame,
    table: Path,
    png: Path,
    svg: Path,
    *,
    note: str | None,
    **settings,
) -> None:
    found = check_inputs(mesh, scans, **settings)
    found.raise_problems()
    write_table(table, found.scans)
    figure = figures.input_figure(
        found.square, patches, patch_size_mm=settings["scan_settings"]["size_mm"], source_note=note
    )
    figures.save_figure(figure, png, svg)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.mesh),
            [ScanFile(Path(file), *use) for file, use in snakemake.params.uses],
            pd.DataFrame(snakemake.params.patches),
            Path(snakemake.output.table),
            Path(snakemake.output.inputs),
            Path(snakemake.output.inputs_svg),
            mesh_unit=snakemake.params.mesh_unit,
            square=snakemake.params.square,
            macroscale=snakemake.params.macroscale,
            scan_settings=snakemake.params.scans,
            maximum_unmeasured=snakemake.params.maximum_unmeasured,
            note=snakemake.params.note,
        )
