"""Run the study with one thing set otherwise, as far as that matters.

Inputs: the study's mesh and scans, and what its stages have stored. Outputs: patch pressures,
scores and change of texture. Settings: the patches, those with a T1 and those studied, the sections
of the config that a sweep rests on, and what is changed in them.
"""

from pathlib import Path

from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.sweep.factors import merged
from gstlib.sweep.outcomes import StoredStudy, outcomes


def main(table: Path, study: StoredStudy, *, base: dict, changes: dict) -> None:
    write_table(table, outcomes(study, base, merged(base, changes)))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        given, params = snakemake.input, snakemake.params

        def by_patch(patches, files):
            return dict(zip(patches, map(Path, files), strict=True))

        main(
            Path(snakemake.output.outcomes),
            StoredStudy(
                mesh=Path(given.mesh),
                mesh_unit=params.mesh_unit,
                surface=Path(given.surface),
                contact=Path(given.contact),
                pressures=Path(given.pressures),
                texture=Path(given.texture),
                crops=dict(zip(params.patches, params.crops, strict=True)),
                t0_scans=by_patch(params.patches, given.t0_scans),
                t1_scans=by_patch(params.worn, given.t1_scans),
                t0=by_patch(params.patches, given.t0),
                t1=by_patch(params.worn, given.t1),
                registered=by_patch(params.worn, given.registered),
                contacts=by_patch(params.studied, given.contacts),
                counterface_scan=Path(given.counterface_scan) if given.counterface_scan else None,
                counterface=Path(given.counterface) if given.counterface else None,
            ),
            base=params.base,
            changes=params.changes,
        )
