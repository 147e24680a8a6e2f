"""Run the study in memory with one value changed."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.sweep import merged, outcomes
from gstlib.counterface import SecondStone
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.tables import write_table
from gstlib.study import Study


def main(
    mesh: Path,
    t0_scans: list[Path],
    t1_scans: list[Path],
    repeat_scans: list[Path],
    counterface_scan: Path,
    counterface: Path,
    outcome: Path,
    *,
    patches: dict[str, list],
    worn: list[str],
    repeated: list[str],
    mesh_unit: str,
    second_stone: dict | None,
    config: dict,
    changes: dict,
) -> None:
    changed = merged(config, changes)
    known = {name: changed["scans"][name] for name in ("unit", "spacing_um")}
    scans = {
        (patch, "T0"): file for patch, file in zip(patches["patch"], t0_scans, strict=True)
    }
    scans |= {(patch, "T1"): file for patch, file in zip(worn, t1_scans, strict=True)}
    scans |= {
        (patch, "repeat"): file for patch, file in zip(repeated, repeat_scans, strict=True)
    }
    study = Study(
        changed,
        pd.DataFrame(patches),
        read_mesh=lambda: read_mesh(mesh, unit=mesh_unit),
        read_scan=lambda *of: read_scan(scans[of], **known),
        read_face=(lambda: read_scan(counterface_scan, **known)) if counterface_scan else None,
        second_stone=SecondStone.read(**second_stone) if counterface else None,
    )
    write_table(outcome, outcomes(study))


if "snakemake" in globals():
    run_script(snakemake, main)
