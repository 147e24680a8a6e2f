"""Gather what was done to each scan, and what each outlier rule finds in it.

Inputs: the prepared surfaces. Outputs: preprocessing.csv, outliers.csv. Settings: patches, those
with a T1.
"""

from pathlib import Path

import pandas as pd

from gstlib.io.store import read_attributes
from gstlib.io.tables import write_table
from gstlib.logs import job_log

COLUMNS = [
    "points",
    "unmeasured",
    "unmeasured_share",
    "filled",
    "outlier_rule",
    "outliers",
    "outlier_share",
    "outlier_k",
    "tilt_x_mrad",
    "tilt_y_mrad",
    "Sq_before_um",
    "Sq_after_um",
    "highest_before_um",
    "highest_after_um",
]


def main(surfaces: dict[tuple[str, str], Path], table: Path, outliers: Path) -> None:
    done, found = [], []
    for (patch, epoch), file in surfaces.items():
        attrs = read_attributes(file)
        scan = {"patch": patch, "epoch": epoch}
        done.append(scan | {name: attrs[name] for name in COLUMNS})
        found.append(scan | compare_rules(attrs))
    write_table(table, pd.DataFrame(done))
    write_table(outliers, pd.DataFrame(found))


def compare_rules(attrs: dict) -> dict:
    """Both rules' outliers of a scan, from the attributes of its surface."""
    window, median, both = (attrs[f"outliers_{name}"] for name in ("window", "median", "both"))
    either = window + median - both
    return {
        "outlier_rule": attrs["outlier_rule"],
        "window_k": attrs["outlier_k_window"],
        "window": window,
        "window_share": window / attrs["points"],
        "median_threshold": attrs["outlier_k_median"],
        "median_scale_um": attrs["outlier_scale_um"],
        "median": median,
        "median_share": median / attrs["points"],
        "both": both,
        "agreement": both / either if either else float("nan"),
    }


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
            Path(snakemake.output.outliers),
        )
