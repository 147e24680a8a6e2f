"""How often does the study find a relation that is there, and one that is not?

    python benchmarks/power.py [--first-seed 2001] [--specimens 100] [--interlayers 10]
        [--wears random waves] [--tables]

Many specimens are generated, each with its wear on summits, with the same wear placed at random,
with wear in waves longer than a patch, and with wear by Archard's law; some are also worn with a
interlayer, and studied with one. `p_values` takes the tests of the study on one of them; its rows
go to benchmarks/results/power.csv. A claim is a p-value at or below a level. Without a relation,
claims must come as often as the level says; with one, their rate is the power
(`rejection_rates`). The use is inferred, as by default; ``taken`` says whether the study took it.
`--wears` measures some kinds of wear alone, and `--tables` prints the rates from the rows alone.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from runner import RESULTS, options, pooled, save
from scipy.stats import beta
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
SPECIMENS, INTERLAYERS = 100, 10
# How specimens wear for the study of the bare stone, and for that with an interlayer.
OF_BARE, OF_INTERLAYER = (*BY_RULE, LAWS[0]), (BY_RULE[0], *LAWS)
WITH_INTERLAYER = ", with an interlayer"
LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
SHOWN = 0.05  # the level whose rates are printed
_TAIL = 0.025  # on either side of a 95 % interval
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
    drawn, wear, taken, p_value``; ``taken`` says whether the study took the use from the wear.
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
    patches = tables["patches"]
    summary = tables["summary"]
    summary = summary.assign(statistic=statistic_names(summary))
    rows = []
    own = own_model(list(summary.model))
    for row in summary[summary.model.isin(["", own])].itertuples():
        name = row.statistic
        if name.startswith(("gain", "relative")):
            better = row.value > 0 if name.startswith("gain") else row.value < 1
            for side, there in (("better", better), ("worse", not better)):
                p = row.p_value / 2 if there else 1 - row.p_value / 2
                rows.append((f"{side}: {name}", np.nan, row.n, p))
        elif name.startswith(("tested", "spearman")):
            rows.append((name, np.nan, row.n, row.p_value))
    generator = np.random.default_rng(seed)
    statistics = patch_statistics(patches, study.registration, study.selected)
    statistics = statistics[statistics.in_statistics]
    order = generator.permutation(len(statistics))
    for drawn in (count for count in _PATCH_COUNTS if count <= len(statistics)):
        chosen = statistics.iloc[np.sort(order[:drawn])]
        pair = rank_correlation(
            chosen, _PREDICTOR, _EXTENT, Draws(generator, _RESAMPLES)
        )
        rows.append((_PAIR, drawn, pair.n, pair.p_value))
    return pd.DataFrame(rows, columns=["test", "drawn", "patches", "p_value"])


def rejection_rates(p_values):
    """How often each test claims a relation, at each of `LEVELS`.

    `p_values` are those of `p_values`, with the specimen's ``seed`` and the placement of its
    ``wear``. A specimen may have several rows for a test, one for each patch. A row without a
    p-value is no trial. The result has ``test, drawn, wear, level, claims, of, specimens, rate,
    low, high``: 95 % Clopper-Pearson interval. Patches of one specimen are no independent trials:
    for these the number of trials is the effective one, by the spread between specimens (Korn and
    Graubard 1998, Surv. Methodol. 24:193).
    """
    rows = []
    kinds = ["test", "drawn", "wear"]
    trials = p_values.dropna(subset="p_value").groupby(kinds, sort=False, dropna=False)
    for kind, group in trials:
        counts = group.groupby("seed").size().to_numpy(float)
        for level in LEVELS:
            claims = (group.p_value <= level).groupby(group.seed).sum().to_numpy(float)
            row = dict(zip(kinds, kind, strict=True)) | {"level": level}
            rows.append(row | rate_of(claims, counts))
    return pd.DataFrame(rows)


def rate_of(claims, counts):
    """The rate of claims (specimens,) among as many tests, with its interval."""
    rate = claims.sum() / counts.sum()
    trials = counts.sum()
    row = {"claims": int(claims.sum()), "of": int(trials), "specimens": len(counts)}
    between = ((claims - rate * counts) ** 2).sum() / trials**2
    between *= len(counts) / max(len(counts) - 1, 1)
    if between > 0:  # else nothing but claims, or none: no sign of clustering
        independent = rate * (1 - rate) / max(trials - 1, 1)
        trials = min(trials, trials * independent / between)
    few, many = rate * trials, trials - rate * trials  # need not be whole
    low = beta.ppf(_TAIL, few, many + 1) if few > 0 else 0.0
    high = beta.ppf(1 - _TAIL, few + 1, many) if many > 0 else 1.0
    return row | {"rate": rate, "low": low, "high": high}


def main(arguments=None):
    chosen = options(
        __doc__,
        RESULT,
        arguments,
        config=[CONFIG],
        first_seed=2001,
        specimens=SPECIMENS,
        interlayers=INTERLAYERS,
        wears={"nargs": "+", "choices": WEARS, "default": list(WEARS)},
    )
    if not chosen.tables:
        config = specimen_config(*chosen.config)
        make = partial(
            specimen_p_values, config, worn_patches(config), wears=chosen.wears
        )
        tasks = [
            (chosen.first_seed + number, interlayer)
            for interlayer, count in (
                (False, chosen.specimens),
                (True, chosen.interlayers),
            )
            for number in range(count)
        ]
        for rows in pooled(make, tasks, chosen.processes):
            save(chosen.output, rows)
    rates = rejection_rates(read_table(chosen.output))
    rates = rates[rates.level == SHOWN].round(3)
    whole = rates[rates.drawn.isna()]
    columns = ["test", "wear", "claims", "of", "specimens", "rate", "low", "high"]
    print(whole[columns].to_string(index=False))
    few = rates[rates.drawn.notna() & (rates.wear == "summits")]
    print(few[["test", "drawn", "rate", "low", "high"]].to_string(index=False))


if __name__ == "__main__":
    main()
