"""Score predicted contact against measured height loss, patch by patch and over the patches.

Inputs: contacts and registered height changes of the patches, microscale_summary.csv.
Outputs: validation_patches.csv, validation_summary.csv.
Settings: the patches, seed and number of resamples.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log
from gstlib.validation.scores import rank_correlations, score_patch


def main(
    contacts: dict[str, Path],
    registered: dict[str, Path],
    microscale: Path,
    patches: Path,
    summary: Path,
    *,
    seed: int,
    resamples: int,
) -> None:
    scores = pd.DataFrame(
        [
            {"patch": patch} | score_patch(contact.height, contact, read_dataset(registered[patch]))
            for patch, contact in ((patch, read_dataset(file)) for patch, file in contacts.items())
        ]
    )
    write_table(patches, scores)
    pressure = read_table(microscale).set_index("patch").mean_pressure_MPa
    correlations = rank_correlations(
        scores.assign(pressure_MPa=scores.patch.map(pressure)),
        resamples=resamples,
        generator=np.random.default_rng(seed),
    )
    write_table(summary, correlations)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            dict(zip(ids, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.microscale),
            Path(snakemake.output.patches),
            Path(snakemake.output.summary),
            seed=snakemake.params.seed,
            resamples=snakemake.params.resamples,
        )
