"""What the prediction of wear is worth, over synthetic specimens: for docs/explanation/evidence.md.

    python benchmarks/verdict.py [--seeds 7001 ...] [--processes 2]
    python benchmarks/verdict.py --tables

Each stone of a fresh seed wears twice, on its summits by rule and by Archard's law, and goes
through the study in memory, with the settings and errors of the default config, so that the use is
read from the wear. Rows of ``wear.csv`` go to `benchmarks/results/verdict.csv`; those that it holds
already are not computed again. A stone takes some 4 minutes of CPU and 3.7 GB. The stones of the
first seeds are also worn with caps on the pressure. `--tables` prints the tables of the document
from the rows alone.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from age import record
from power import asked, specimen_config, specimen_studies, worn_patches

from gstlib.io.tables import read_table, write_table
from gstlib.study import Study
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.inference import Draws, exchange_p_value, mean_of, ratio_of_sums
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import BARE, wear_patch
from gstlib.wear.fit import Prediction, wear_map

RESULT = Path(__file__).parent / "results/verdict.csv"
WORN_BY = ("summits", "archard")
SEEDS = range(7001, 7021)
# Caps on the pressure, MPa, that the first stones are worn with, too.
STRENGTHS, WITH_STRENGTHS = (300.0, 1000.0, 2000.0), 3
RESAMPLES = 9999


def scored(study: Study, strengths: Sequence[float]) -> pd.DataFrame:
    """Rows of ``wear.csv`` of one specimen, and whether each patch is counted."""
    worn = asked(lambda of: of.worn_square, study)
    if worn is None:
        raise SystemExit("no wear is predicted")
    contacts = {patch: study.contacts[patch] for patch in study.worn}
    predicted = {}
    for patch, contact in contacts.items():
        maps = [wear_map(contact, worn, patch)]
        for limit in strengths:
            depth = wear_patch(contact, worn, patch, pressure_cap=limit)
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
    known = tables["patches"][["patch", "in_statistics"]]
    known = known.merge(study.selected[["patch", "pressure_MPa"]], on="patch")
    return tables["wear"].merge(known, on="patch")


def rows_of(seed: int, *, with_strengths: bool) -> pd.DataFrame:
    """Rows of one stone, worn in both ways."""
    config = specimen_config()
    strengths = STRENGTHS if with_strengths else ()
    found = [
        scored(study, strengths).assign(seed=seed, worn_by=worn_by)
        for worn_by, study in specimen_studies(config, worn_patches(config), seed, WORN_BY)
    ]
    return pd.concat(found, ignore_index=True)


def model_table(rows: pd.DataFrame) -> pd.DataFrame:
    """By kind of wear and model: means over patches, with 95 % intervals over the stones.

    ``against`` compares Archard's law with that model, stone by stone: the difference of mean MCC
    and its two-sided p-value.
    """
    found = []
    for worn_by, of_kind in rows[rows.in_statistics].groupby("worn_by", sort=False):
        volume_error = (of_kind.predicted_volume_um3 - of_kind.measured_volume_um3).abs()
        of_kind = of_kind.assign(volume_error=volume_error)
        by_stone = of_kind.groupby(["model", "seed"], sort=False)
        mcc = by_stone.mcc.mean().unstack("model")
        errors = {
            name: by_stone[name].sum().unstack("model")
            for name in ("map_error_um", "volume_error")
        }
        attainable = by_stone.attainable_mcc.mean().unstack("model")
        for model in (BARE, *BASELINES, ORACLE):
            draws = Draws(np.random.default_rng(1), RESAMPLES)
            gain = (mcc[BARE] - mcc[model]).to_numpy()
            row = {"worn by": worn_by, "model": model, "stones": len(mcc)}
            row["mean MCC"] = _shown(mean_of(mcc[model].to_numpy(), draws))
            row["attainable"] = f"{attainable[model].mean():.2f}"
            if model != BARE:
                row["law's gain"] = _shown(mean_of(gain, draws))
                row["p"] = f"{exchange_p_value(gain, draws.generator):.2g}"
            for name, of in errors.items():
                if model != BARE:
                    ratio = ratio_of_sums(of[BARE].to_numpy(), of[model].to_numpy(), draws)
                    row[f"law's {name} / its"] = _shown(ratio)
            found.append(row)
    return pd.DataFrame(found).fillna("")


def strength_table(rows: pd.DataFrame) -> pd.DataFrame:
    """By kind of wear: the elastic prediction and those with caps, on the same patches."""
    names = [f"{limit:g} MPa" for limit in STRENGTHS]
    tried = rows[rows.seed.isin(rows.seed[rows.model.isin(names)]) & rows.in_statistics]
    tried = tried[tried.model.isin([BARE, *names])]
    table = tried.groupby(["worn_by", "model"], sort=False).agg(
        stones=("seed", "nunique"),
        marked=("marked_fraction", "mean"),
        mcc=("mcc", "mean"),
        map_error_um=("map_error_um", "mean"),
    )
    return table.reset_index().round(3)


def _shown(estimate) -> str:
    return f"{estimate.value:.2f} [{estimate.low:.2f}, {estimate.high:.2f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    options = parser.parse_args()
    rows = read_table(RESULT) if (adds := RESULT.exists()) else None
    if not options.tables:
        known = set() if rows is None else set(rows.seed)
        wanted = [seed for seed in options.seeds if seed not in known]
        # not forked: the transforms' threads would not come along
        context = get_context("spawn")
        with ProcessPoolExecutor(options.processes, mp_context=context) as processes:
            first = set(options.seeds[:WITH_STRENGTHS])
            jobs = {
                processes.submit(rows_of, seed, with_strengths=seed in first): seed
                for seed in wanted
            }
            for job in as_completed(jobs):
                rows = pd.concat([rows, job.result()], ignore_index=True)
                rows = rows.sort_values("seed", kind="stable", ignore_index=True)
                write_table(RESULT, rows)
                record(RESULT, adds=adds)
                print(f"seed {jobs[job]}: done", flush=True)
    for table in (model_table(rows), strength_table(rows)):
        print(table.to_string(index=False), end="\n\n")


if __name__ == "__main__":
    main()
