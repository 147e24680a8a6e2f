"""Gather how well T1 lies over T0 on each patch, and which patches that rules out.

Inputs: the registered patches. Outputs: registration.csv. Settings: patches, selection rules.
"""

from pathlib import Path

import pandas as pd

from gstlib.coupling import select_patches
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.validation.change import wear_summary

QUALITY = [
    "shift_x_um",
    "shift_y_um",
    "rotation_deg",
    "overlap",
    "correlation",
    "detail_correlation",
    "residual_um",
    "change_sigma_um",
    "lateral_sigma_um",
    "level_of_detection_um",
    "known_share",
]
WEAR = ["loss_fraction", "gain_fraction", "loss_volume_um3", "loss_depth_um"]


def main(registered: dict[str, Path], table: Path, *, selection: dict[str, float]) -> None:
    rows = []
    for patch, file in registered.items():
        change = read_dataset(file, only=["change", "loss", "gain"])
        wear = wear_summary(change)
        rows.append(
            {"patch": patch, "found": bool(change.attrs["registration_found"])}
            | {name: change.attrs[name] for name in QUALITY}
            | {name: wear[name] for name in WEAR}
        )
    quality = pd.DataFrame(rows)
    judged = select_patches(
        # the pressures have their own table: here all pass
        pd.DataFrame({"patch": quality.patch, "pressure_MPa": 1.0}),
        quality.assign(correlation=quality.detail_correlation.where(quality.found)),
        **selection | {"minimum_pressure_MPa": 0.0},
    )
    write_table(table, quality.assign(excluded=~judged.in_study, reason=judged.reason))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        patches = zip(snakemake.params.patches, map(Path, snakemake.input.registered), strict=True)
        main(dict(patches), Path(snakemake.output.table), selection=snakemake.params.selection)
