"""Take one generated specimen through the study, with each of its kinds of wear."""

from pathlib import Path

import pandas as pd
from gstlib.power import law_p_values, p_values, specimen_studies

from gst.logs import run_script
from gstlib.io.tables import write_table
from gstlib.specimen.stone import WEAR_LAWS, WEAR_PLACEMENTS


def main(
    table: Path,
    tests: Path,
    scores: Path,
    *,
    patches: dict[str, list],
    specimen_seed: int,
    laws: bool,
    config: dict,
) -> None:
    seed = [config["seed"], specimen_seed]
    found, scored = [], []
    kinds = (*WEAR_PLACEMENTS, *(WEAR_LAWS if laws else ()))
    for wear, study in specimen_studies(config, pd.DataFrame(patches), specimen_seed, kinds):
        if wear in WEAR_PLACEMENTS:
            of_wear, of_patches = p_values(study, seed=seed)
            found.append(of_wear.assign(wear=wear))
            scored.append(of_patches.assign(wear=wear))
        if laws:
            found.append(law_p_values(study, seed=config["seed"]).assign(wear=wear))
    for path, rows in ((tests, found), (scores, scored)):
        result = pd.concat(rows, ignore_index=True)
        result.insert(0, "seed", specimen_seed)
        write_table(path, result)


if "snakemake" in globals():
    run_script(snakemake, main)
