"""Compare each patch with the macroscale surface under it. A wrong position is a fault."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.config.tables import write_table
from gst.run.batches import files_of
from gst.run.logs import run_in_snakemake
from gstlib.coupling.placement import check_placement
from gstlib.io.store import Stored, read_dataset


def main(
    face: Path,
    t0: list[Path],
    table: Path,
    *,
    patches: dict[str, list],
    **settings: Any,
) -> None:
    """`settings` are arguments of `check_placement`."""
    height = read_dataset(face, only=["height"]).height
    scans = Stored(files_of(t0, patches["patch"]), ["height"])
    write_table(
        table, check_placement(height, pd.DataFrame(patches), scans, **settings)
    )


run_in_snakemake(main)
