"""What errors that correlate change, as on measured repeats: for docs/explanation/evidence.md.

    python benchmarks/verdict.py --config benchmarks/correlated.yaml \\
        --output benchmarks/results/verdict_correlated.csv --seeds 7001 ...
    python benchmarks/power.py --config benchmarks/power.yaml benchmarks/correlated.yaml \\
        --output benchmarks/results/power_correlated.csv --specimens 40 --interlayers 0 \\
        --wears random waves archard
    python benchmarks/correlated.py [--seeds 7001 ...] [--processes 2]
    python benchmarks/correlated.py --tables

The last two commands compare these rows with those of the same stones in `verdict.csv` and
`power.csv`, whose errors at neighbouring points are independent. The third also scans stones twice
that were not used in between, with both kinds of errors: loss and gain are then false.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import power
from age import CORRELATED
from runner import RESULTS, run_stones
from specimens import specimen_config, study_of, worn_patches
from verdict import SEEDS, model_table

from gstlib.io.tables import read_table
from gstlib.specimen.generate import make_specimen
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.wear.archard import BARE

RESULT = RESULTS / "correlated.csv"
CHANGED = Path(__file__).with_suffix(".yaml")
ERRORS = "independent", "correlated"
# Errors of the scans of a stone that was not used, with a number of repeats that measure them.
UNWORN = {
    ERRORS[0]: ([], 0),
    ERRORS[1]: ([CHANGED], 0),
    "correlated, two repeats": ([CHANGED], 2),
}
BASELINE = "pressure_volume"  # the best one, or nearly
MEASURED = ["level_of_detection_um", "loss_fraction", "gain_fraction", "above_noise"]


def rows_of(seed):
    """Loss and gain on each patch of a stone that was not used, with each kind of errors."""
    tables = []
    for errors, (files, repeats) in UNWORN.items():
        config = specimen_config(*files)
        patches = worn_patches(config)
        patches["repeat"] = patches.t0.where(patches.index < repeats, "")
        specimen = make_specimen(
            patches,
            SpecimenParameters(**config["specimen"] | {"seed": seed}),
            square_mm=config["square"]["size_mm"],
            grid=config["macroscale"]["grid"],
            wear=lambda stone: np.zeros_like(stone.heights),
        )
        table = study_of(config, patches, specimen).registration
        table = table.loc[table.found, ["patch", *MEASURED]]
        tables.append(table.assign(seed=seed, errors=errors))
    return pd.concat(tables, ignore_index=True)


def false_losses(rows):
    """By kind of errors: the false loss and gain, and how many patches count as worn."""
    rows = rows.assign(counted=rows.above_noise & (rows.loss_fraction > 0))
    groups = rows.groupby("errors", sort=False)
    table = groups[MEASURED[:3]].agg(["median", "max"])
    table.columns = [f"{name}_{of}" for name, of in table]
    return table.assign(patches=groups.size(), counted=groups.counted.sum())


def of_both(name, kind):
    """The rows of the stones and kinds of wear that were studied with both kinds of errors."""
    both = [read_table(RESULTS / f"{name}{end}.csv") for end in ("", CORRELATED)]
    common = pd.merge(*(rows[["seed", kind]].drop_duplicates() for rows in both))
    return {
        errors: rows.merge(common, on=["seed", kind])
        for errors, rows in zip(ERRORS, both, strict=True)
    }


def verdicts():
    """By kind of wear and of errors: the scores of Archard's law, beside the best baseline."""
    tables = []
    for errors, rows in of_both("verdict", "worn_by").items():
        counted = rows[rows.model == BARE].groupby("worn_by").in_statistics.mean()
        models = model_table(rows).set_index(["model", "worn by"])
        table = models.loc[BASELINE].join(counted)
        table["law's MCC"] = models.loc[BARE, "mean MCC"]
        tables.append(table.assign(errors=errors))
    return pd.concat(tables).sort_index(kind="stable").reset_index()


def rates():
    """How often each test claims a relation, with independent errors and with correlated ones."""
    tables = [
        power.rejection_rates(rows).query("level == @power.SHOWN and drawn.isna()")
        for rows in of_both("power", "wear").values()
    ]
    return pd.merge(*tables, on=["test", "wear"], suffixes=("", CORRELATED))


def tables(rows):
    return false_losses(rows), verdicts(), rates()


if __name__ == "__main__":
    run_stones(__doc__, RESULT, rows_of, tables, SEEDS[:10])
