"""Does the wear tell how a tool was used, and does the study claim a use where there was none?

    python benchmarks/use.py [--first-seed 5001] [--specimens 20] [--wears archard summits]

Stones are made that a law wore (`archard`), at a load point and against a radius that are drawn
from what the study takes for possible beforehand; the study is told the middle of the square and
200 mm. The same stones are also worn by rules that know no contact: on summits, at random, in
waves. Writes benchmarks/results/use.csv (with --output: elsewhere), a row for each stone, kind of
wear and what is known of each patch (`losses`, or `grades` from 0 to 3, of which a fifth are wrong
by one):

true_*, mean_*   load point and logarithm of the radius, as they were and as they were found;
below_*          the share of what was found that lies below the truth;
effective_draws, p_value, gain, gain_error, answer   as in `gstlib.use.infer.infer_use`;
told, inferred, known   r.m.s. error of the mean depths lost, each predicted from the others, over
                 that of no loss at all: with the use as told, as inferred, and as it was;
cpu_s            of the inference.

`--tables` prints coverage, errors and rates of claims from the rows alone. `--grades FILE` writes
the patch table of config/artefact.yaml, with grades in place of scans, and nothing else.
"""

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from power import asked, specimen_config, specimen_studies, worn_patches

from gstlib.io.tables import read_table, write_table
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.study import Study
from gstlib.use.evidence import Evidence, Grades, Losses, weigh
from gstlib.use.infer import (
    BETTER,
    Sampling,
    StatedUse,
    infer_use,
    losses_of,
    predicted_losses,
    use_pressures,
)

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks/results/use.csv"
LAW = "archard"
WEARS = (LAW, "summits")
# ASSUME: a stone is pressed within its square: uses beyond it cannot be told from each other.
EDGE_MM = 0.5
# Grades: the shares of the patches below each, and of those that are wrong by one.
BELOW_GRADES, WRONG = (0.4, 0.65, 0.85), 0.2
# The stone of config/artefact.yaml, and the use that the study is not told.
ARTEFACT_SEED = 4104
_NAMES = ("y_mm", "x_mm", "log_radius")


def drawn_use(config: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """A use that the study takes for possible, as parameters of a specimen."""
    generator = np.random.default_rng([seed, 8])
    errors, half = config["uncertainty"], config["square"]["size_mm"] / 2
    off = errors["load_point_mm"] * generator.standard_normal(2)
    off = np.clip(off, EDGE_MM - half, half - EDGE_MM)
    log_radius = errors["radius_fraction"] * generator.standard_normal()
    radius = config["counterface"]["radius_mm"] * np.exp(log_radius)
    return {"worn_off_middle_mm": tuple(map(float, off)), "worn_radius_mm": float(radius)}


def grades_of(losses: Losses, generator: np.random.Generator) -> Grades:
    """The losses as an eye would grade them, some of them wrong by one."""
    limits = np.quantile(losses.depth_um, BELOW_GRADES)
    grade = np.searchsorted(limits, losses.depth_um)
    wrong = generator.random(len(grade)) < WRONG
    grade[wrong] += generator.choice([-1, 1], wrong.sum())
    return Grades(np.clip(grade, 0, len(BELOW_GRADES)))


def relative_error(predicted: np.ndarray, losses: Losses) -> float:
    """R.m.s. error of predicted losses over that of none."""
    error = np.square(predicted - losses.depth_um).mean()
    return float(np.sqrt(error / np.square(losses.depth_um).mean()))


def known_error(pressure: np.ndarray, losses: Losses) -> float:
    """That of the losses at these pressures (patches,), each from the others."""
    seen = weigh(losses, pressure[None])
    return relative_error(seen.without["wear_coefficient"][0] * pressure, losses)


def rows_of(study: Study, seed: int, wear: str) -> Iterator[dict[str, Any]]:
    """What the wear of one stone tells, from losses and from grades."""
    settings = dict(study.settings["infer_use"])
    stated = StatedUse(**settings.pop("stated"))
    sampling = Sampling(**settings.pop("sampling"))
    patches, losses = losses_of(study.patches, asked(lambda of: of.registration, study))
    specimen = SpecimenParameters(**study.config["specimen"])
    middle = study.config["square"]["size_mm"] / 2
    true = [middle + off for off in specimen.worn_off_middle_mm]
    true.append(float(np.log(specimen.worn_radius_mm)))
    told = [*stated.through, float(np.log(stated.radius_mm))]
    at = use_pressures(np.array([told, true]), study.composite, patches, stated, **settings)
    kinds: dict[str, Evidence] = {"losses": losses}
    kinds["grades"] = grades_of(losses, np.random.default_rng([seed, 9]))
    for kind, evidence in kinds.items():
        start = time.process_time()
        use = infer_use(
            study.composite, patches, evidence, stated, sampling=sampling, **settings
        )
        row = {"seed": seed, "wear": wear, "evidence": kind, "patches": len(patches)}
        found = use.assign(log_radius=np.log(use.radius_mm))
        for name, truth in zip(_NAMES, true, strict=True):
            values, weight = found[name].values, use.weight.values
            row |= {f"true_{name}": truth, f"mean_{name}": weight @ values}
            row[f"below_{name}"] = weight @ (values < truth)
        row |= {name: use.attrs[name] for name in ("effective_draws", "p_value", "gain")}
        row |= {name: use.attrs[name] for name in ("gain_error", "answer")}
        row["cpu_s"] = time.process_time() - start
        if kind == "losses":
            predicted = predicted_losses(use, losses, sampling.seed).predicted_um.to_numpy()
            row["told"], row["known"] = (known_error(of, losses) for of in at)
            row["inferred"] = relative_error(predicted, losses)
        yield row


def stone_rows(
    config: Mapping[str, Any], patches: pd.DataFrame, seed: int, wears: Sequence[str]
) -> list[dict[str, Any]]:
    """Those of one stone with each kind of wear."""
    config = {**config, "specimen": config["specimen"] | drawn_use(config, seed)}
    studies = specimen_studies(config, patches, seed, wears)
    return [row for wear, study in studies for row in rows_of(study, seed, wear)]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """What the rows of a benchmark show, from losses and from grades.

    By ``evidence``: ``stones`` that the law wore; median errors of the load point along ``y_mm``
    and ``x_mm`` and of ``log_radius``; ``held_50`` and ``held_95``, percent of these that lie in
    the middle 50 and 95 % of what was found; median errors of the losses, ``told``, ``inferred``
    and ``known``; ``claims``, stones that the law wore whose wear a use is said to explain better
    than heights alone, and ``false_claims`` among ``others``, those that a rule wore.
    """
    found = {}
    for kind, of in rows.groupby("evidence", sort=False):
        law, rule = of[of.wear == LAW], of[of.wear != LAW]
        row: dict[str, Any] = {"stones": len(law)}
        for name in _NAMES:
            row[name] = abs(law[f"mean_{name}"] - law[f"true_{name}"]).median()
        below = law[[f"below_{name}" for name in _NAMES]].to_numpy()
        row |= {
            f"held_{share}": 100 * (abs(below - 0.5) < share / 200).mean() for share in (50, 95)
        }
        row |= law[["told", "inferred", "known"]].median().to_dict()
        row["claims"], row["false_claims"] = (
            (each.answer == BETTER).sum() for each in (law, rule)
        )
        found[kind] = row | {"others": len(rule)}
    return pd.DataFrame(found).T


def write_grades(config: Mapping[str, Any], patches: pd.DataFrame, file: Path) -> None:
    """The patch table of a tool of which there are grades alone."""
    ((_, study),) = specimen_studies(config, patches, ARTEFACT_SEED, [LAW])
    known, losses = losses_of(patches, study.registration)
    grade = grades_of(losses, np.random.default_rng([ARTEFACT_SEED, 9])).grade
    table = known[["patch", "x_mm", "y_mm"]].assign(wear_grade=grade)
    head = (
        "# Made by `python benchmarks/use.py --grades FILE`: losses of a synthetic stone, as an "
        "eye would grade them.\n"
    )
    text = table.to_csv(sep="\t", index=False, float_format="%.10g", lineterminator="\n")
    file.write_text(head + text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first-seed", type=int, default=5001)
    parser.add_argument("--specimens", type=int, default=20)
    parser.add_argument("--wears", nargs="+", default=WEARS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=RESULT)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    parser.add_argument("--grades", type=Path, help="write the table of the artefact alone")
    options = parser.parse_args()
    config = specimen_config()
    patches = worn_patches(config)
    if options.grades:
        write_grades(config, patches, options.grades)
        return
    if not options.tables:
        found: list[dict[str, Any]] = []
        # not forked: the transforms' threads would not come along
        context = get_context("spawn")
        with ProcessPoolExecutor(options.processes, mp_context=context) as processes:
            jobs = [
                processes.submit(
                    stone_rows, config, patches, options.first_seed + number, options.wears
                )
                for number in range(options.specimens)
            ]
            for number, job in enumerate(jobs, start=1):
                found += job.result()
                write_table(options.output, pd.DataFrame(found))
                print(f"{number} of {len(jobs)} stones", flush=True)
    print(summary(read_table(options.output)).round(2).T.to_string())


if __name__ == "__main__":
    main()
