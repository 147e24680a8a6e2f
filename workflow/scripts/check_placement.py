"""Compare each patch with the macroscale surface under it; a place that is wrong is a fault."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.config.tables import write_table
from gst.run.batches import files_of
from gst.run.logs import run_script
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
    """`settings` are those of `check_placement`."""
    height = read_dataset(face, only=["height"]).height
    scans = Stored(files_of(t0, patches["patch"]), ["height"])
    write_table(
        table, check_placement(height, pd.DataFrame(patches), scans, **settings)
    )


if "snakemake" in globals():
    run_script(snakemake, main)
