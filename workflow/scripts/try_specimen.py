"""Take one generated specimen through the study, with each placement of its wear."""

from pathlib import Path

import pandas as pd

from gstlib.io.tables import write_table
from gstlib.logs import run_script
from gstlib.power import p_values, specimen_studies


def main(
    table: Path,
    tests: Path,
    scores: Path,
    *,
    patches: dict[str, list],
    specimen_seed: int,
    config: dict,
) -> None:
    seed = [config["seed"], specimen_seed]
    found, scored = [], []
    for wear, study in specimen_studies(config, pd.DataFrame(patches), specimen_seed):
        of_wear, of_patches = p_values(study, seed=seed)
        found.append(of_wear.assign(wear=wear))
        scored.append(of_patches.assign(wear=wear))
    for path, rows in ((tests, found), (scores, scored)):
        result = pd.concat(rows, ignore_index=True)
        result.insert(0, "seed", specimen_seed)
        write_table(path, result)


if "snakemake" in globals():
    run_script(snakemake, main)
