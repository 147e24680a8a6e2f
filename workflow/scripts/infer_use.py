"""Infer the load case from the losses of the patches, or from grades of wear."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import face_of, table_of, write_result
from gstlib.use.outcome import use_of_study


def main(
    face: Path,
    registration: Path | list,
    use: Path,
    table: Path,
    losses: Path | None = None,
    *,
    patches: dict[str, list],
    settings: dict[str, Any],
) -> None:
    """The file `use` has only attributes if no load case can be inferred."""
    inferred, answers, predicted = use_of_study(
        face_of(face), pd.DataFrame(patches), table_of(registration), **settings
    )
    write_result(use, inferred, "infer_use")
    write_table(table, answers)
    if losses is not None:
        write_table(losses, predicted)


run_in_snakemake(main)
