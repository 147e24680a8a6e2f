"""How often does the study find a relation that is there, and one that is not?

    python benchmarks/power.py [--first-seed 2001] [--specimens 70] [--interlayers 10]
        [--wears random waves] [--tables]

Many specimens are generated, each with its wear on summits, with the same wear placed at random,
with wear in waves longer than a patch, and with wear by Archard's law; some are also worn with a
interlayer, and studied with one. `p_values` takes the tests of the study on one of them; its rows
go to benchmarks/results/power.csv. A claim is a p-value at or below a level. Without a relation,
claims must come as often as the level says; with one, their rate is the power
(`rejection_rates`). The use is inferred, as by default; ``adopted`` says whether the study took it.
`--wears` measures some kinds of wear alone, and `--tables` prints the rates from the rows alone.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from runner import RESULTS, options, pooled, save
from scipy.stats import binomtest
from specimens import (
    BY_RULE,
    LAWS,
    WEARS,
    asked,
    specimen_config,
    specimen_studies,
    worn_patches,
)

from gstlib.io.tables import read_table
from gstlib.validation.inference import Draws, rank_correlation
from gstlib.validation.scoring import own_model
from gstlib.validation.summary import patch_statistics, statistic_names

CONFIG, RESULT = Path(__file__).with_name("power.yaml"), RESULTS / "power.csv"
# How many specimens there are, and how many of them are studied with an interlayer, too.
SPECIMENS, INTERLAYERS = 70, 10
# How specimens wear for the study of the bare stone, and for that with an interlayer.
OF_BARE, OF_INTERLAYER = (*BY_RULE, LAWS[0]), (BY_RULE[0], *LAWS)
WITH_INTERLAYER = ", with an interlayer"
LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
SHOWN = 0.05  # the level whose rates are printed
_PREDICTOR, _EXTENT = "pressure_MPa", "loss_fraction"
_PAIR = f"spearman({_PREDICTOR}, {_EXTENT})"
# ASSUME: what can be had with fewer patches is that of so many drawn at random from a specimen's.
_PATCH_COUNTS = (4, 6, 8, 10, 12)
_RESAMPLES = 999  # draws of chance; intervals are not used here


def specimen_p_values(config, patches, specimen_seed, interlayer, wears=tuple(WEARS)):
    """P-values of every test on one specimen, with each of its kinds of wear that is in `wears`.

    `config`, `patches` and `specimen_seed` are as in `specimen_studies`. Without `interlayer`,
    the study knows nothing of the config's interlayer. With it, the specimen wears by rule and by
    each law, and the names of the tests end with `WITH_INTERLAYER`. The result has ``seed, test,
    drawn, wear, adopted, p_value``; ``adopted`` says whether the study took the use from the wear.
    """
    if not interlayer:
        config = {**config, "interlayer": None}
    tables = []
    kinds = [
        wear for wear in (OF_INTERLAYER if interlayer else OF_BARE) if wear in wears
    ]
    for wear, study in specimen_studies(config, patches, specimen_seed, kinds):
        table = p_values(study, seed=[config["seed"], specimen_seed])
        adopted = study.use is not None and bool(study.use.attrs["adopted"])
        names = table.test + WITH_INTERLAYER * interlayer
        tables.append(
            table.assign(wear=wear, adopted=adopted, test=names, seed=specimen_seed)
        )
    columns = ["seed", "test", "drawn", "wear", "adopted", "p_value"]
    return pd.concat(tables, ignore_index=True)[columns]


def p_values(study, *, seed):
    """P-values of every test of the study on one specimen with one kind of wear.

    Random numbers are drawn from `seed`. The result has ``test, drawn, patches, p_value``.
    The tests have the names of ``validation_summary.csv``, of the study's own prediction. A gain
    over a baseline or no loss is claimed by ``better(...)`` and ``worse(...)``, one-sided: of the
    study's two-sided test, half its p-value on the side where the difference lies. The rank
    correlation of pressure and loss is also taken over so many patches ``drawn`` at random.
    """
    tables = asked(lambda study: study.scored(seed=seed, resamples=_RESAMPLES), study)
    summary = tables["summary"]
    summary = summary.assign(statistic=statistic_names(summary))
    rows = []
    own = summary[summary.model.isin(["", own_model(list(summary.model))])]
    for row in own.itertuples():
        name, p = row.statistic, row.p_value
        if name.startswith(("gain", "relative")):
            is_better = row.value > 0 if name.startswith("gain") else row.value < 1
            better = p / 2 if is_better else 1 - p / 2
            rows.append((f"better: {name}", np.nan, row.n, better))
            rows.append((f"worse: {name}", np.nan, row.n, 1 - better))
        elif name.startswith(("tested", "spearman")):
            rows.append((name, np.nan, row.n, p))
    generator = np.random.default_rng(seed)
    statistics = patch_statistics(tables["patches"], study.registration, study.selected)
    statistics = statistics[statistics.in_statistics]
    order = generator.permutation(len(statistics))
    for drawn in (count for count in _PATCH_COUNTS if count <= len(statistics)):
        few = statistics.iloc[np.sort(order[:drawn])]
        draws = Draws(generator, _RESAMPLES)
        pair = rank_correlation(few, _PREDICTOR, _EXTENT, draws)
        rows.append((_PAIR, drawn, pair.n, pair.p_value))
    return pd.DataFrame(rows, columns=["test", "drawn", "patches", "p_value"])


def rejection_rates(p_values):
    """How often each test claims a relation, at each of `LEVELS`.

    `p_values` are those of `p_values`, with the specimen's ``seed`` and the placement of its
    ``wear``. A row without a p-value is no trial, and the rows of tests of single patches, which
    an earlier program made, are left out. The result has ``test, drawn, wear, level, claims, of,
    specimens, rate, low, high``: 95 % Clopper-Pearson interval.
    """
    trials = p_values.dropna(subset="p_value")
    trials = trials[trials.test.str.contains("(", regex=False)]
    kinds = ["test", "drawn", "wear"]
    rows = []
    for kind, group in trials.groupby(kinds, sort=False, dropna=False):
        for level in LEVELS:
            claims = int((group.p_value <= level).sum())
            interval = binomtest(claims, len(group)).proportion_ci()
            row = dict(zip(kinds, kind, strict=True)) | {"level": level}
            row |= {"claims": claims, "of": len(group)}
            row |= {"specimens": group.seed.nunique(), "rate": claims / len(group)}
            rows.append(row | interval._asdict())
    return pd.DataFrame(rows)


def main():
    chosen = options(
        __doc__,
        RESULT,
        config=[CONFIG],
        first_seed=2001,
        specimens=SPECIMENS,
        interlayers=INTERLAYERS,
        wears={"nargs": "+", "choices": WEARS, "default": list(WEARS)},
    )
    if not chosen.tables:
        config = specimen_config(*chosen.config)
        patches = worn_patches(config)
        make = partial(specimen_p_values, config, patches, wears=chosen.wears)
        tasks = [(chosen.first_seed + k, False) for k in range(chosen.specimens)]
        tasks += [(chosen.first_seed + k, True) for k in range(chosen.interlayers)]
        for rows in pooled(make, tasks, chosen.processes):
            save(chosen.output, rows)
    rates = rejection_rates(read_table(chosen.output))
    rates = rates[rates.level == SHOWN].round(3)
    columns = ["test", "wear", "claims", "of", "specimens", "rate", "low", "high"]
    print(rates[rates.drawn.isna()][columns].to_string(index=False))
    few = rates[rates.drawn.notna() & (rates.wear == "summits")]
    print(few[["test", "drawn", "rate", "low", "high"]].to_string(index=False))


if __name__ == "__main__":
    main()
