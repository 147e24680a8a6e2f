"""Make one specimen, with its wear on summits and placed at random, and try the study on both.

Inputs: the patch table. Outputs: the p-value of every test; the scores of every studied patch.
Settings: the specimen's seed, and the sections of the config that a study rests on.
"""

from pathlib import Path

import pandas as pd

from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.power import p_values, try_specimen
from gstlib.specimen import SpecimenParameters


def main(
    tests: Path,
    scores: Path,
    patches: pd.DataFrame,
    *,
    seed: int,
    specimen: dict,
    validation: dict,
    **settings,
) -> None:
    trials = try_specimen(patches, SpecimenParameters(**{**specimen, "seed": seed}), **settings)
    names = ("shifts", "neighbourhood_um", "curvature_length_um", "most_noise")
    found, scored = p_values(
        trials,
        seed=[validation["seed"], seed],
        **{name: validation[name] for name in names},
    )
    for path, table in ((tests, found), (scores, scored)):
        table.insert(0, "seed", seed)
        write_table(path, table)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.output.tests),
            Path(snakemake.output.scores),
            pd.DataFrame(snakemake.params.patches),
            seed=int(snakemake.wildcards.seed),
            patch_mm=snakemake.params.patch_mm,
            contact_modulus_MPa=snakemake.params.contact_modulus_MPa,
            **snakemake.params.sections,
        )
