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

import argparse
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from age import record
from scipy.stats import beta

from gst.config.reading import complete, read_config_file, read_study
from gstlib.errors import InputError
from gstlib.io.tables import read_table, write_table
from gstlib.specimen.generate import make_specimens
from gstlib.specimen.law import wear_depth
from gstlib.specimen.randomness import (
    ROLL_OFF_MM,
    SpecimenParameters,
    self_affine_field,
    stream,
)
from gstlib.specimen.stone import Stone
from gstlib.study import Study
from gstlib.validation.inference import Draws, rank_correlation
from gstlib.validation.scoring import own_model
from gstlib.validation.summary import patch_statistics

__all__ = [
    "LEVELS",
    "asked",
    "merged",
    "p_values",
    "rejection_rates",
    "specimen_config",
    "specimen_p_values",
]
__all__ += ["WEARS", "specimen_studies", "worn_patches"]

ROOT = Path(__file__).parents[1]
CONFIG, RESULT = ROOT / "benchmarks/power.yaml", ROOT / "benchmarks/results/power.csv"
# How many specimens there are, and how many of them are studied with an interlayer, too.
SPECIMENS, INTERLAYERS = 100, 10
# How specimens wear for the study of the bare stone, and for that with an interlayer.
BY_RULE, LAWS = ("summits", "random", "waves"), ("archard", "interlayer")
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
# Stages that no scan after use enters; of the latter, only while the use is as stated.
_BEFORE_USE = "face", "composite", "square_contact", "counterface"
_OF_STATED_USE = "contact", "pressures"
_TESTS = ["test", "drawn", "patches", "p_value"]


def merged(config: Mapping, changes: Mapping) -> dict:
    """The config with some of its values replaced; neither of the two is altered."""
    result = dict(config)
    for key, value in changes.items():
        is_section = isinstance(value, Mapping) and isinstance(config.get(key), Mapping)
        result[key] = merged(config[key], value) if is_section else value
    return result


def specimen_config(*files: Path) -> dict[str, Any]:
    """The default config with what `files` change in it."""
    config: dict[str, Any] = {}
    for file in (ROOT / "config/config.yaml", *files):
        config = merged(config, read_config_file(file))
    config = complete(config)
    config["patches"] = str(ROOT / config["patches"])
    return config


def worn_patches(config: Mapping[str, Any]) -> pd.DataFrame:
    """The patches of a config that have a T1."""
    patches = read_study(config, "config")
    return patches[patches.t1 != ""].reset_index(drop=True)


def worn_at_random(stone: Stone) -> np.ndarray:
    """Wear on summits, with its amount, shapes and clusters, moved elsewhere by chance."""
    # ASSUME: every shift is equally likely, so that on average over shifts the wear has no
    # covariance with any surface.
    generator = stream(stone.parameters.seed, "wear", "placement")
    depth = stone.worn_by_rules()
    return np.roll(depth, generator.integers(0, len(depth), 2), axis=(0, 1))


def worn_in_waves(stone: Stone) -> np.ndarray:
    """Wear of one depth, that of summits, on ``wear_fraction`` in waves longer than a patch."""
    # ASSUME: wear that follows something other than heights, such as the hand's grip, varies over
    # lengths like the stone's. It has one depth, so it is detected wherever it lies.
    p, depth = stone.parameters, stone.worn_by_rules()
    field = self_affine_field(
        stream(p.seed, "wear", "waves"),
        len(depth),
        stone.spacing,
        hurst_exponent=p.hurst_exponent,
        roll_off=ROLL_OFF_MM,
    )
    worn = field > np.quantile(field, 1 - p.wear_fraction)
    return np.where(worn, depth.sum() / max((depth > 0).sum(), 1), 0).astype(np.float32)


# How a stone can lose height: by the specimen's rule, with no relation to heights, and by law.
WEARS = {name: partial(wear_depth, placement=name) for name in ("summits", *LAWS)}
WEARS |= {"random": worn_at_random, "waves": worn_in_waves}


def specimen_p_values(
    config: Mapping[str, Any],
    patches: pd.DataFrame,
    specimen_seed: int,
    *,
    interlayer: bool,
    wears: Collection[str] = tuple(WEARS),
) -> pd.DataFrame:
    """P-values of every test on one specimen, with each of its kinds of wear that is in `wears`.

    `config`, `patches` and `specimen_seed` are as in `specimen_studies`. Without `interlayer`,
    the study knows nothing of the config's interlayer. With it, the specimen wears by rule and by
    each law, and the names of the tests end with `WITH_INTERLAYER`. The result has ``seed, test,
    drawn, wear, taken, p_value``; ``taken`` says whether the study took the use from the wear.
    """
    if not interlayer:
        config = {**config, "interlayer": None}
    found = []
    kinds = [wear for wear in (OF_INTERLAYER if interlayer else OF_BARE) if wear in wears]
    for wear, study in specimen_studies(config, patches, specimen_seed, kinds):
        table = p_values(study, seed=[config["seed"], specimen_seed])
        taken = study.use is not None and bool(study.use.attrs["taken"])
        names = table.test + WITH_INTERLAYER * interlayer
        found.append(table.assign(wear=wear, taken=taken, test=names))
    table = pd.concat(found, ignore_index=True).assign(seed=specimen_seed)
    return table[["seed", "test", "drawn", "wear", "taken", "p_value"]]


def specimen_studies(
    config: Mapping[str, Any],
    patches: pd.DataFrame,
    specimen_seed: int,
    wears: Sequence[str] = BY_RULE,
) -> Iterator[tuple[str, Study]]:
    """Each of these `WEARS`, one by one, and the study of the specimen with that wear.

    The later studies take from the first every stage that no scan after use enters.

    `config` has ``seed``, ``specimen`` and the sections of a study; each patch
    has a T1; `specimen_seed` takes the place of that of ``specimen``.
    """
    specimens = make_specimens(
        patches,
        replace(SpecimenParameters(**config["specimen"]), seed=specimen_seed),
        square_mm=config["square"]["size_mm"],
        grid=config["macroscale"]["grid"],
        wear={name: WEARS[name] for name in wears},
    )
    first: Study | None = None
    for wear, specimen in specimens.items():
        study = Study(
            config,
            patches,
            read_mesh=lambda specimen=specimen: specimen.mesh,  # type: ignore[misc]
            read_scan=lambda *of, specimen=specimen: specimen.scans[of],  # type: ignore[misc]
        )
        if first is not None:
            take(study, first, _BEFORE_USE)
            scans = {of: scan for of, scan in first.prepared.items() if of[1] != "T1"}
            study.prepared.update(scans)
            if config["use"] is None:
                take(study, first, _OF_STATED_USE)
                study.contacts.update(first.contacts)
        yield wear, study
        first = first or study


def take(study: Study, other: Study, stages: Iterable[str]) -> None:
    """Give a study the stages that another one has computed."""
    for stage in stages:
        if stage in vars(other):
            setattr(study, stage, vars(other)[stage])


def asked(ask: Callable[[Study], Any], study: Study) -> Any:
    """What `ask` finds on a study without the T1 that it refuses, as its message advises."""
    while True:
        try:
            return ask(study)
        except InputError as error:
            refused = re.match(r"patch (\w+), T1", str(error.source))
            if refused is None:
                raise
            study.worn.remove(refused[1])


def p_values(study: Study, *, seed: Sequence[int]) -> pd.DataFrame:
    """P-values of every test of the study on one specimen with one kind of wear.

    Random numbers are drawn from `seed`. The result has ``test, drawn, patches, p_value``.
    The tests have the names of ``validation_summary.csv``, of the study's own prediction. A gain
    over a baseline or no loss is claimed by ``better(...)`` and ``worse(...)``, one-sided: of the
    study's two-sided test, half its p-value on the side where the difference lies. The rank
    correlation of pressure and loss is also taken over so many patches ``drawn`` at random.
    """
    tables = asked(lambda study: study.scored(seed=seed, resamples=_RESAMPLES), study)
    patches, summary = tables["patches"], tables["summary"]
    rows, own = [], own_model(list(summary.model))
    for row in summary[summary.model.isin(["", own])].itertuples():
        name = row.statistic
        if name.startswith(("gain", "relative")):
            better = row.value > 0 if name.startswith("gain") else row.value < 1
            for side, there in (("better", better), ("worse", not better)):
                p = row.p_value / 2 if there else 1 - row.p_value / 2
                rows.append((f"{side}: {name}", np.nan, row.n, p))
        elif name.startswith(("tested", "spearman")):
            rows.append((name, np.nan, row.n, row.p_value))
    generator, places = np.random.default_rng(seed), study.selected
    known = patch_statistics(patches, study.registration, places)
    known = known[known.in_statistics]
    order = generator.permutation(len(known))
    for drawn in (count for count in _PATCH_COUNTS if count <= len(known)):
        chosen = known.iloc[np.sort(order[:drawn])]
        pair = rank_correlation(chosen, _PREDICTOR, _EXTENT, Draws(generator, _RESAMPLES))
        rows.append((_PAIR, drawn, pair.n, pair.p_value))
    return pd.DataFrame(rows, columns=_TESTS)


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
    parser.add_argument("--specimens", type=int, default=SPECIMENS)
    parser.add_argument(
        "--interlayers",
        type=int,
        default=INTERLAYERS,
        help="of these, how many are studied with an interlayer",
    )
    parser.add_argument("--wears", nargs="+", choices=list(WEARS), default=list(WEARS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=RESULT)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    options = parser.parse_args(arguments)
    if not options.tables:
        config = specimen_config(*options.config)
        patches = worn_patches(config)
        found = []
        # not forked: the transforms' threads would not come along
        context = get_context("spawn")
        with ProcessPoolExecutor(options.processes, mp_context=context) as processes:
            jobs = [
                processes.submit(
                    specimen_p_values,
                    config,
                    patches,
                    options.first_seed + number,
                    interlayer=interlayer,
                    wears=options.wears,
                )
                for interlayer, count in (
                    (False, options.specimens),
                    (True, options.interlayers),
                )
                for number in range(count)
            ]
            for number, job in enumerate(jobs, start=1):
                found.append(job.result())
                write_table(options.output, pd.concat(found, ignore_index=True))
                print(f"{number} of {len(jobs)} studies", flush=True)
        record(options.output)
    rates = rejection_rates(read_table(options.output))
    shown = rates[(rates.level == SHOWN) & rates.drawn.isna()].round(3)
    columns = ["test", "wear", "claims", "of", "specimens", "rate", "low", "high"]
    print(shown[columns].to_string(index=False))
    few = rates[(rates.level == SHOWN) & rates.drawn.notna() & (rates.wear == "summits")]
    print(few[["test", "drawn", "rate", "low", "high"]].round(3).to_string(index=False))


if __name__ == "__main__":
    main()
