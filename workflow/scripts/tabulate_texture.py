"""Measure the texture of every patch before and after use.

Inputs: the prepared surfaces at T0, T1 laid over T0. Outputs: texture.csv. Settings: patches, those
with a T1, nesting indices of the filters.
"""

import logging
from pathlib import Path

import pandas as pd

from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log, patch_by_patch
from gstlib.validation.texture import texture_rows


def main(
    surfaces: dict[str, Path],
    registered: dict[str, Path],
    table: Path,
    *,
    s_filter_um: float,
    l_filter_um: float | None,
) -> None:
    rows = []
    for patch, file in patch_by_patch(surfaces):
        t1 = read_dataset(registered[patch], only=["t1"]) if patch in registered else None
        of_patch = texture_rows(
            read_dataset(file, only=["height"]).height,
            t1,
            s_filter_um=s_filter_um,
            l_filter_um=l_filter_um,
        )
        if t1 is not None and len(of_patch) == 1:
            logging.getLogger("gstlib").warning(
                "patch %s: T1 was not found on T0, or covers too little of it: T0 alone", patch
            )
        rows += [{"patch": patch} | row for row in of_patch]
    write_table(table, pd.DataFrame(rows))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.patches, map(Path, snakemake.input.t0), strict=True)),
            dict(zip(snakemake.params.worn, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.output.table),
            **snakemake.params.texture,
        )
