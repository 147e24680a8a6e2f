"""Gather what was done to each scan.

Inputs: the prepared surfaces. Outputs: preprocessing.csv. Settings: patches, those with a T1.
"""

from pathlib import Path

import pandas as pd

from gstlib.io.store import read_attributes
from gstlib.io.tables import write_table
from gstlib.logs import job_log

COLUMNS = [
    "unmeasured",
    "filled",
    "outliers",
    "outlier_k",
    "tilt_x_mrad",
    "tilt_y_mrad",
    "Sq_before_um",
    "Sq_after_um",
]


def main(surfaces: dict[tuple[str, str], Path], table: Path) -> None:
    rows = []
    for (patch, epoch), file in surfaces.items():
        attrs = read_attributes(file)
        rows.append({"patch": patch, "epoch": epoch} | {name: attrs[name] for name in COLUMNS})
    write_table(table, pd.DataFrame(rows))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        files = {
            (patch, epoch): Path(file)
            for epoch, patches, scans in [
                ("T0", snakemake.params.patches, snakemake.input.t0),
                ("T1", snakemake.params.worn, snakemake.input.t1),
            ]
            for patch, file in zip(patches, scans, strict=True)
        }
        order = {patch: rank for rank, patch in enumerate(snakemake.params.patches)}
        main(
            dict(sorted(files.items(), key=lambda item: (order[item[0][0]], item[0][1]))),
            Path(snakemake.output.table),
        )
