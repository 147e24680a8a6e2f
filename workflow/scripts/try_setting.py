"""Run the study in memory with one value changed."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.sweep import merged, outcomes
from gstlib.counterface import read_counterface
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.tables import write_table
from gstlib.study import Study


def main(
    mesh: Path,
    t0_scans: list[Path],
    t1_scans: list[Path],
    counterface_scan: Path,
    counterface: Path,
    outcome: Path,
    *,
    patches: dict[str, list],
    worn: list[str],
    mesh_unit: str,
    second_stone: dict | None,
    config: dict,
    changes: dict,
) -> None:
    table, changed = pd.DataFrame(patches), merged(config, changes)
    scans = {(patch, "T0"): file for patch, file in zip(table.patch, t0_scans, strict=True)}
    scans |= {(patch, "T1"): file for patch, file in zip(worn, t1_scans, strict=True)}
    scans["counterface", ""] = counterface_scan
    known = {name: changed["scans"][name] for name in ("unit", "spacing_um")}
    study = Study(
        changed,
        table,
        read_mesh=lambda: read_mesh(mesh, unit=mesh_unit),
        read_scan=lambda *of: read_scan(scans[of], **known),
        worn=worn,
        has_counterface=bool(counterface_scan),
        second_stone=read_counterface(second_stone) if counterface else None,
    )
    write_table(outcome, outcomes(study))


if "snakemake" in globals():
    run_script(snakemake, main)
