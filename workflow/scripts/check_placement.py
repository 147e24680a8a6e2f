"""Compare each patch with the macroscale surface under it. A wrong position is a fault."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, scans_of
from gstlib.coupling.placement import check_placement


def main(
    face: Path,
    t0: list[Path],
    table: Path,
    *,
    patches: dict[str, list],
    **settings: Any,
) -> None:
    """`settings` are arguments of `check_placement`."""
    height = dataset_of(face, ["height"]).height
    scans = scans_of(t0, patches["patch"])
    placement = check_placement(height, pd.DataFrame(patches), scans, **settings)
    write_table(table, placement)


run_in_snakemake(main)
