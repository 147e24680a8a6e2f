"""What the prediction of wear is worth, over synthetic specimens: for docs/explanation/evidence.md.

    python benchmarks/verdict.py [--seeds 7001 ...] [--processes 2]
    python benchmarks/verdict.py --config benchmarks/correlated.yaml \\
        --output benchmarks/results/verdict_correlated.csv --seeds 7001 ...
    python benchmarks/verdict.py --tables

Each stone of a fresh seed wears twice, on its summits by rule and by Archard's law, and goes
through the study in memory, with the settings and errors of the default config and of the files
in `--config`, so that the use is read from the wear. Rows of ``wear.csv`` go to
`benchmarks/results/verdict.csv`; those that it holds already are not computed again. A stone takes
some 4 minutes of CPU and 3.7 GB. The stones of the first seeds are also worn with caps on the
pressure. `--tables` prints the tables of the document from the rows alone.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from runner import RESULTS, run_stones
from specimens import asked, specimen_config, specimen_studies, worn_patches

from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.inference import Draws, exchange_p_value, mean_of, ratio_of_sums
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import BARE, wear_patch
from gstlib.wear.fit import Prediction, wear_map

RESULT = RESULTS / "verdict.csv"
WORN_BY = ("summits", "archard")
SEEDS = range(7001, 7021)
# Caps on the pressure, MPa, that the first stones are worn with, too.
STRENGTHS, WITH_STRENGTHS = (300.0, 1000.0, 2000.0), 3
RESAMPLES = 9999


def scored(study, strengths):
    """Rows of ``wear.csv`` of one specimen, and whether each patch is counted."""
    worn = asked(lambda study: study.worn_square, study)
    if worn is None:
        raise SystemExit("no wear is predicted")
    contacts = {patch: study.contacts[patch] for patch in study.worn}
    predicted = {}
    for patch, contact in contacts.items():
        maps = [wear_map(contact, worn, patch)]
        for limit in strengths:
            depth = wear_patch(contact, worn, patch, pressure_cap=limit)[-1]
            named = maps[0].assign_coords(model=[f"{limit:g} MPa"])
            maps.append(named.copy(data={"depth": depth[None]}))
        predicted[patch] = xr.concat(maps, "model")
    tables = score_wear(
        contacts,
        {patch: study.changes[patch] for patch in study.worn},
        Prediction(predicted, worn.fitted_to),
        study.selected,
        study.registration,
        seed=1,
        resamples=99,
    )
    counted = tables["patches"][["patch", "in_statistics"]]
    counted = counted.merge(study.selected[["patch", "pressure_MPa"]], on="patch")
    return tables["wear"].merge(counted, on="patch")


def rows_of(seed, files):
    """Rows of one stone, worn in both ways; `files` change the default config."""
    config = specimen_config(*files)
    strengths = STRENGTHS if seed in SEEDS[:WITH_STRENGTHS] else ()
    studies = specimen_studies(config, worn_patches(config), seed, WORN_BY)
    tables = [
        scored(study, strengths).assign(seed=seed, worn_by=worn_by)
        for worn_by, study in studies
    ]
    return pd.concat(tables, ignore_index=True)


def model_table(rows):
    """By kind of wear and model: means over patches, with 95 % intervals over the stones.

    Archard's law is compared with each other model, stone by stone: the difference of mean MCC and
    its two-sided p-value, and the ratios of their errors.
    """
    table = []
    for worn_by, group in rows[rows.in_statistics].groupby("worn_by", sort=False):
        volume_error = (group.predicted_volume_um3 - group.measured_volume_um3).abs()
        by_stone = group.assign(volume_error=volume_error).groupby(
            ["model", "seed"], sort=False
        )
        mcc, attainable = (
            by_stone[name].mean().unstack("model") for name in ("mcc", "attainable_mcc")
        )
        for model in (BARE, *BASELINES, ORACLE):
            draws = Draws(np.random.default_rng(1), RESAMPLES)
            gain = (mcc[BARE] - mcc[model]).to_numpy()
            row = {"worn by": worn_by, "model": model, "stones": len(mcc)}
            row["mean MCC"] = _shown(mean_of(mcc[model].to_numpy(), draws))
            row["attainable"] = f"{attainable[model].mean():.2f}"
            if model != BARE:
                row["law's gain"] = _shown(mean_of(gain, draws))
                row["p"] = f"{exchange_p_value(gain, draws.generator):.2g}"
                for name in ("map_error_um", "volume_error"):
                    errors = by_stone[name].sum().unstack("model")[[BARE, model]]
                    ratio = ratio_of_sums(*errors.to_numpy().T, draws)
                    row[f"law's {name} / its"] = _shown(ratio)
            table.append(row)
    return pd.DataFrame(table).fillna("")


def strength_table(rows):
    """By kind of wear: the elastic prediction and those with caps, on the same patches."""
    names = [f"{limit:g} MPa" for limit in STRENGTHS]
    tried = rows[rows.seed.isin(rows.seed[rows.model.isin(names)]) & rows.in_statistics]
    groups = tried[tried.model.isin([BARE, *names])].groupby(
        ["worn_by", "model"], sort=False
    )
    table = groups[["predicted_worn_fraction", "mcc", "map_error_um"]].mean()
    table.insert(0, "stones", groups.seed.nunique())
    return (
        table.rename(columns={"predicted_worn_fraction": "marked"})
        .reset_index()
        .round(3)
    )


def _shown(estimate):
    return f"{estimate.value:.2f} [{estimate.low:.2f}, {estimate.high:.2f}]"


def tables(rows):
    return model_table(rows), strength_table(rows)


if __name__ == "__main__":
    default = {"type": Path, "nargs": "*", "default": []}
    run_stones(__doc__, RESULT, rows_of, tables, SEEDS, config=default)
