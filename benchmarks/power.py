"""How often does the study find a relation that is there, and one that is not?

    python benchmarks/power.py [--first-seed 2001] [--specimens 100] [--laws 30] [--config FILE ...]

Many specimens are generated, each with its wear on summits, with the same wear placed at random,
and with wear in waves longer than a patch; some also with wear by Archard's law, without and with a
mat. `p_values` takes the tests of the study on one of them, `law_p_values` those of the law.
A claim is a p-value at or below a level. Without a relation, claims must come as often as the level
says; with one, their rate is the power (`rejection_rates`), which goes to
benchmarks/results/power.csv. On two cores that takes half an hour.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta

from gst.config import complete, read_study
from gst.config_file import read_config_file
from gst.sweep import merged
from gstlib.io.tables import write_table
from gstlib.specimen.generate import make_specimens
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import WEAR_LAWS, WEAR_PLACEMENTS
from gstlib.study import Study
from gstlib.validation.scoring import Chance, patch_tables, score_table
from gstlib.validation.summary import (
    believed,
    mean_gains,
    mean_scores,
    rank_correlation,
    spatial_p_value,
)

__all__ = ["LEVELS", "law_p_values", "p_values", "rejection_rates"]
__all__ += ["specimen_config", "specimen_p_values", "specimen_studies"]

ROOT = Path(__file__).parents[1]
CONFIG, RESULT = ROOT / "benchmarks/power.yaml", ROOT / "benchmarks/results/power.csv"
LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
SCORES = ("f1", "roc_auc")  # the one of areas, the other of rankings
_TAIL = 0.025  # on either side of a 95 % interval
_PREDICTOR, _EXTENT = "pressure_MPa", "loss_fraction"
_PAIR = f"spearman({_PREDICTOR}, {_EXTENT})"
# ASSUME: what can be had with fewer patches is that of so many drawn at random from a specimen's.
_PATCH_COUNTS = (4, 6, 8, 10, 12)
_RESAMPLES = 99  # for intervals, which are not used here
_OF_USE = "change", "selected", "worn_square"  # stages that scans after use enter
_TESTS = ["test", "drawn", "patches", "p_value"]


def specimen_config(*files: Path) -> dict[str, Any]:
    """The default config with what `files` change in it."""
    config: dict[str, Any] = {}
    for file in (ROOT / "config/config.yaml", *files):
        config = merged(config, read_config_file(file))
    config = complete(config)
    config["patches"] = str(ROOT / config["patches"])
    return config


def specimen_p_values(
    config: Mapping[str, Any], patches: pd.DataFrame, specimen_seed: int, *, laws: bool
) -> pd.DataFrame:
    """P-values of every test on one specimen, with each of its kinds of wear.

    `config`, `patches` and `specimen_seed` are as in `specimen_studies`. With `laws` the specimen
    also wears by each law, and it is asked of every kind whether a law is at work. The result has
    ``seed, test, drawn, wear, p_value``.
    """
    seed = [config["seed"], specimen_seed]
    kinds = (*WEAR_PLACEMENTS, *(WEAR_LAWS if laws else ()))
    found = []
    for wear, study in specimen_studies(config, patches, specimen_seed, kinds):
        if wear in WEAR_PLACEMENTS:
            found.append(p_values(study, seed=seed)[0].assign(wear=wear))
        if laws:
            found.append(law_p_values(study, seed=config["seed"]).assign(wear=wear))
    table = pd.concat(found, ignore_index=True).assign(seed=specimen_seed)
    return table[["seed", "test", "drawn", "wear", "p_value"]]


def specimen_studies(
    config: Mapping[str, Any],
    patches: pd.DataFrame,
    specimen_seed: int,
    wear_placements: Sequence[str] = WEAR_PLACEMENTS,
) -> Iterator[tuple[str, Study]]:
    """Where wear lies, one by one, and the study of the specimen with that wear.

    The later studies take from the first every stage that no scan after use enters.

    `config` has ``seed``, ``specimen`` and the sections `gstlib.study.STUDY_SECTIONS`; each patch
    has a T1; `specimen_seed` takes the place of that of ``specimen``.
    """
    specimens = make_specimens(
        patches,
        replace(SpecimenParameters(**config["specimen"]), seed=specimen_seed),
        square_mm=config["square"]["size_mm"],
        grid=config["macroscale"]["grid"],
        wear_placements=wear_placements,
    )
    kept: dict[tuple[str, ...], Any] = {}
    for wear, specimen in specimens.items():
        study = Study(
            config,
            patches,
            read_mesh=lambda specimen=specimen: specimen.mesh,  # type: ignore[misc]
            read_scan=lambda *of, specimen=specimen: specimen.scans[of],  # type: ignore[misc]
            kept=kept,
        )
        yield wear, study
        kept = {
            (stage, *of): found
            for (stage, *of), found in study.kept.items()
            if stage not in _OF_USE and of[1:] != ["T1"]
        }


def p_values(study: Study, *, seed: Sequence[int]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """P-values of every test of the study on one specimen with one placement of its wear.

    Nulls and permutations are drawn from `seed`.

    Returns
    -------
    tests : pandas.DataFrame
        ``test, drawn, patches, p_value``. Tests of one patch have their score's name, ``f1``; those
        over the patches, all or so many ``drawn`` at random, that of ``validation_summary.csv``.
        Beside the permutation of patches stands the test that allows for spatial autocorrelation
        (`spatial_p_value`). The p-value of a gain is one-sided: small where contact is better.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, pressure_MPa`` and the scores of each patch.
    """
    shifts = study.config["validation"]["shifts"]
    found, places = (study.scores(Chance(seed, shifts, _RESAMPLES)), study.selected())
    table = places[["patch", "x_mm", "y_mm", "pressure_MPa"]].merge(
        score_table(found), on="patch"
    )
    gains = patch_tables(found)["gains"]
    of_patch = gains[gains.score.isin(SCORES)]
    rows = [(row.score, np.nan, 1, row.p_value) for row in of_patch.itertuples()]
    found, every, table = believed(found), table, table[table.believed.astype(bool)]
    if table.empty:
        return pd.DataFrame(rows, columns=_TESTS), every
    generator = np.random.default_rng(seed)
    chance: dict[str, Any] = {"generator": generator, "resamples": _RESAMPLES}
    gains = mean_gains(table, **chance)
    # the study claims a difference either way; here only that contact is better
    gains["p_value"] = np.where(gains.value > 0, gains.p_value / 2, 1 - gains.p_value / 2)
    wanted = [f"{kind}({score})" for kind in ("mean", "gain") for score in SCORES]
    summary = pd.concat([mean_scores(found, **chance), gains]).set_index("statistic")
    rows += [
        (row.Index, np.nan, row.n, row.p_value) for row in summary.loc[wanted].itertuples()
    ]
    order = generator.permutation(len(table))
    for drawn in (np.nan, *(count for count in _PATCH_COUNTS if count <= len(table))):
        chosen = table if np.isnan(drawn) else table.iloc[np.sort(order[:drawn])]
        pair = rank_correlation(chosen, _PREDICTOR, _EXTENT, **chance).iloc[0]
        pressure, loss = chosen[[_PREDICTOR, _EXTENT]].to_numpy(float).T
        positions = chosen[["x_mm", "y_mm"]].to_numpy()
        spatial = spatial_p_value(pressure, loss, positions, permuted=pair.p_value)
        rows.append((_PAIR, drawn, pair.n, pair.p_value))
        rows.append((f"{_PAIR}, neighbours allowed for", drawn, pair.n, spatial))
    return pd.DataFrame(rows, columns=_TESTS), every


def law_p_values(study: Study, *, seed: int) -> pd.DataFrame:
    """P-values of the claim that a law of wear is at work on a specimen.

    ``test, drawn, patches, p_value`` as in `p_values`; the tests are ``law(archard)`` and, where
    the config has a mat, ``law(mat)``. A law is claimed where its maps of loss err less than those
    of every rival; a mat must beat the bare stone out of contact, too (`wear_summary` of
    `gstlib.validation.wear_scores`). The p-value, one-sided, is the largest.
    """
    summary = study.wear(seed=seed, resamples=_RESAMPLES)[-1]
    named = summary.statistic.isin(["skill(map)", "skill(out_of_contact)"])
    skill = summary[named].dropna(subset="p_value")
    p = np.where(skill.value > 0, skill.p_value / 2, 1 - skill.p_value / 2)
    rows = (
        skill.assign(p_value=p).groupby("model", sort=False).agg({"p_value": "max", "n": "max"})
    )
    rows = rows.rename(columns={"n": "patches"}).reset_index()
    return rows.assign(test="law(" + rows.model + ")", drawn=np.nan)[_TESTS]


def rejection_rates(p_values: pd.DataFrame) -> pd.DataFrame:
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
    for kind, group in p_values.dropna(subset="p_value").groupby(
        kinds, sort=False, dropna=False
    ):
        of = group.groupby("seed").size().to_numpy(float)
        for level in LEVELS:
            claimed = (group.p_value <= level).groupby(group.seed).sum().to_numpy(float)
            rate, trials = claimed.sum() / of.sum(), of.sum()
            between = ((claimed - rate * of) ** 2).sum() / trials**2
            between *= len(of) / max(len(of) - 1, 1)
            if between > 0:  # else nothing but claims, or none: no sign of clustering
                independent = rate * (1 - rate) / max(trials - 1, 1)
                trials = min(trials, trials * independent / between)
            few, many = rate * trials, trials - rate * trials  # need not be whole
            low = beta.ppf(_TAIL, few, many + 1) if few > 0 else 0.0
            high = beta.ppf(1 - _TAIL, few + 1, many) if many > 0 else 1.0
            rows.append(
                (*kind, level, int(claimed.sum()), int(of.sum()), len(of), rate, low, high)
            )
    columns = [*kinds, "level", "claims", "of", "specimens", "rate", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, nargs="+", default=[CONFIG])
    parser.add_argument("--first-seed", type=int, default=2001)
    parser.add_argument("--specimens", type=int, default=100)
    parser.add_argument(
        "--laws", type=int, default=30, help="of these, how many wear by laws, too"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=RESULT)
    options = parser.parse_args(arguments)
    config = specimen_config(*options.config)
    patches = read_study(config, " + ".join(map(str, options.config)))
    patches = patches[patches.t1 != ""].reset_index(drop=True)
    found = []
    # not forked: the transforms' threads would not come along
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as processes:
        jobs = [
            processes.submit(
                specimen_p_values,
                config,
                patches,
                options.first_seed + number,
                laws=number < options.laws,
            )
            for number in range(options.specimens)
        ]
        for number, job in enumerate(jobs, start=1):
            found.append(job.result())
            print(f"{number} of {options.specimens} specimens", flush=True)
    write_table(options.output, rejection_rates(pd.concat(found, ignore_index=True)))
    print(options.output)


if __name__ == "__main__":
    main()
