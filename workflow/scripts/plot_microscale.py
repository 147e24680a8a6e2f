"""Draw the contact of every patch, and their curves.

Inputs: the patches' contacts. Outputs: a PNG and an SVG each. Settings: the patches, a note on the
source.
"""

from pathlib import Path

from gstlib import figures
from gstlib.io.store import read_dataset
from gstlib.logs import job_log


def main(contacts: dict[str, Path], output: dict[str, Path], *, note: str | None) -> None:
    """`output` maps the name of each figure to its PNG, and ``<name>_svg`` to its SVG."""
    solved = {patch: read_dataset(file) for patch, file in contacts.items()}
    drawn = {
        "microscale_maps": figures.microscale_maps_figure(solved, source_note=note),
        "microscale_curves": figures.microscale_curves_figure(solved, source_note=note),
    }
    for name, figure in drawn.items():
        figures.save_figure(figure, output[name], output[f"{name}_svg"])


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.patches, map(Path, snakemake.input.contacts), strict=True)),
            {name: Path(file) for name, file in snakemake.output.items()},
            note=snakemake.params.note,
        )
