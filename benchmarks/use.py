"""Does the wear tell how a tool was used, and does the study claim a use where there was none?

    python benchmarks/use.py [--cases law random …] [--seeds 5001 5010] [--fine]
    python benchmarks/use.py --tables

Stones are made that a law wore, at a load point and against a radius that are drawn from what the
study takes for possible beforehand; the study is told the middle of the square and 200 mm. Scans
have 128 × 128 points, or 512 × 512 with --fine; all else is as in config/config.yaml. Seeds were
chosen before any stone was made:

law              5001 to 5040, worn by the law; from `losses`, and from `grades` from 0 to 3, of
                 which a fifth are wrong by one
summits, random, waves   5001 to 5020, worn by rules that know no contact
12, 8            5011 to 5030, worn by the law: so many patches, by chance
wrong            5011 to 5030, worn by the law: one patch of the more worn half has the loss of one
                 of the other half
two radii        5201 to 5205, worn by the law and a tool of two radii, 1.56 to 1 like the paper's;
                 the study is told a round tool, its true form, and that turned by 90°
outside          5101 to 5110, worn by the law at a load point beyond the square; the study is told
                 that it may err by 2 mm

Writes benchmarks/results/use.csv (with --output: elsewhere), a row for each stone, case and what is
known of each patch; stones that the file holds already are not made again:

true_*, mean_*   load point and logarithm of the radius, as they were and as they were found;
below_*          the share of what was found that lies below the truth;
sd_*             the standard deviation of what was found;
effective_draws, p_value, gain, gain_error, answer   as in `gstlib.use.infer.infer_use`;
log_score        log probability of each loss, given the others, summed;
told, inferred, known   r.m.s. error of the mean depths lost, each predicted from the others, over
                 that of no loss at all: with the use as told, as inferred, and as it was;
mcc_*            mean over the worn patches of the MCC of the predicted places of wear, likewise;
within_95        share of the losses within the 95 % that are predicted from the others;
cpu_s            of the inference.

`--tables` prints coverage, errors and rates of claims from the rows alone. `--grades FILE` writes
the patch table of config/artefact.yaml, with grades in place of scans, and nothing else.
"""

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from age import record
from power import asked, merged, specimen_config, specimen_studies, take, worn_patches

from gstlib.conditions import study_radius
from gstlib.io.tables import read_table, write_table
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.study import Study
from gstlib.use.evidence import Evidence, Grades, Losses, weigh
from gstlib.use.infer import BETTER, StatedUse, infer_use, use_pressures
from gstlib.use.outcome import losses_of, predicted_losses, share_within
from gstlib.use.sampling import Sampling

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks/results/use.csv"
LAW = "archard"
# ASSUME: the contact of the macroscale knows nothing of what a coarser scan leaves out.
COARSE = {"scan_points": 128, "scan_spacing_um": 6.64, "unmeasured_size_um": 20.0}
# ASSUME: a stone is pressed within its square: uses beyond it cannot be told from each other.
EDGE_MM = 0.5
# How far beyond the square the load point of the case `outside` lies, and what the study is told.
OUTSIDE_MM, TOLD_OUTSIDE_MM = (0.25, 1.5), 2.0
# The longer radius over the shorter one of the case `two radii`.
ASPECT = 169 / 108
# Grades: the shares of the patches below each, and of those that are wrong by one.
BELOW_GRADES, WRONG = (0.4, 0.65, 0.85), 0.2
# The stone of config/artefact.yaml, and the use that the study is not told.
ARTEFACT_SEED = 4104
_NAMES = ("y_mm", "x_mm", "log_radius")
_RESAMPLES = 99  # the tests of the study are not used


class Case(NamedTuple):
    """What is tried on so many stones from a seed on: how they wore, and what is changed."""

    wear: str
    first_seed: int
    stones: int


CASES = {
    "law": Case(LAW, 5001, 40),
    **{wear: Case(wear, 5001, 20) for wear in ("summits", "random", "waves")},
    **{name: Case(LAW, 5011, 20) for name in ("12", "8", "wrong")},
    "two radii": Case(LAW, 5201, 5),
    "outside": Case(LAW, 5101, 10),
}
# Cases that are studied from grades, too.
GRADED = ("law", "summits")
# Cases of the stones of `law` that need no stone of their own.
CHANGED = ("12", "8", "wrong")


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


def pushed_outside(config: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """The same with the load point beyond an edge of the square."""
    generator = np.random.default_rng([seed, 10])
    half = config["square"]["size_mm"] / 2
    beyond = [generator.choice([-1, 1]) * (half + generator.uniform(*OUTSIDE_MM))]
    beyond.append(generator.uniform(-half, half))
    off = tuple(float(beyond[at]) for at in generator.permutation(2))
    return drawn_use(config, seed) | {"worn_off_middle_mm": off}


def two_radii(radius_mm: float) -> tuple[float, float]:
    """Radii of an ellipsoidal tool, along its longer axis and across it, of this mean."""
    return radius_mm * ASPECT**0.5, radius_mm / ASPECT**0.5


def changed(
    patches: pd.DataFrame, losses: Losses, case: str, seed: int
) -> tuple[pd.DataFrame, Losses]:
    """Patches and losses of a stone, as in a case of `CHANGED`."""
    generator = np.random.default_rng([seed, 11])
    if case == "wrong":
        depth_um, order = losses.depth_um.copy(), losses.depth_um.argsort(kind="stable")
        less, more = (generator.choice(half) for half in np.array_split(order, 2))
        depth_um[more] = depth_um[less]
        return patches, Losses(depth_um)
    chosen = np.sort(generator.permutation(len(patches))[: int(case)])
    return patches.iloc[chosen].reset_index(drop=True), losses.permuted(chosen)


def known_use(true: Sequence[float], pressure: np.ndarray, patches: pd.DataFrame) -> xr.Dataset:
    """The use as it was, as `gstlib.use.infer.infer_use` would find it."""
    y_mm, x_mm, log_radius = true
    one = {"y_mm": y_mm, "x_mm": x_mm, "radius_mm": np.exp(log_radius), "weight": 1.0}
    by_patch = {"pressure": pressure, "weight_without": np.ones(len(patches))}
    return xr.Dataset(
        {name: ("draw", [of]) for name, of in one.items()}
        | {name: (("draw", "patch"), of[None]) for name, of in by_patch.items()},
        {"patch": list(patches.patch)},
    )


def mean_mcc(study: Study, use: xr.Dataset | None) -> float:
    """Mean MCC over the worn patches of a study at a use, 0 where it predicts no wear."""
    given = {name: getattr(study, name) for name in ("read_mesh", "read_scan")}
    other = Study(study.config, study.patches, **given)
    take(other, study, ("face", "composite", "square_contact", "detection", "registration"))
    other.prepared.update(study.prepared)
    other.changes.update(study.changes)
    other.worn, other.use = study.worn, use
    found = other.scored(seed=1, resamples=_RESAMPLES)["patches"]
    if "mcc" not in found:
        return 0.0
    worn = study.registration.set_index("patch").above_noise.astype(bool)
    mcc = found.set_index("patch").mcc
    return float(mcc[worn.reindex(mcc.index)].fillna(0).mean())


def tried(
    study: Study, known: tuple[pd.DataFrame, Losses], case: str, seed: int
) -> Iterator[tuple[str, pd.DataFrame, Evidence, xr.Dataset]]:
    """What is known of the patches in a case, by name, and the face with its active tool."""
    patches, losses = known
    if case in CHANGED:
        patches, losses = changed(patches, losses, case, seed)
    yield "losses", patches, losses, study.composite
    if case in GRADED:
        grades = grades_of(losses, np.random.default_rng([seed, 9]))
        yield "grades", patches, grades, study.composite
    if case == "two radii":
        angle, radius = study.config["specimen"]["worn_angle_deg"], study_radius(study.config)
        radii, middle = two_radii(radius), 2 * (study.config["square"]["size_mm"] / 2,)
        for form, turn in (("true form", angle), ("turned form", angle + 90)):
            over = rounded_counterface(study.composite.height, radii, middle, turn)
            yield form, patches, losses, study.composite.assign(counterface=over)


def rows_of(study: Study, seed: int, cases: Sequence[str]) -> Iterator[dict[str, Any]]:
    """What the wear of one stone tells in some cases of its wear."""
    settings = dict(study.settings["infer_use"])
    stated = StatedUse(**settings.pop("stated"))
    sampling = Sampling(**settings.pop("sampling"))
    known = losses_of(study.patches, asked(lambda of: of.registration, study))
    specimen = SpecimenParameters(**study.config["specimen"])
    middle = study.config["square"]["size_mm"] / 2
    true = [middle + off for off in specimen.worn_off_middle_mm]
    true.append(float(np.log(specimen.worn_radius_mm).mean()))
    told = [*stated.through, float(np.log(stated.radius_mm))]
    for case in cases:
        for kind, patches, evidence, face in tried(study, known, case, seed):
            row = {"seed": seed, "case": case, "evidence": kind, "patches": len(patches)}
            row["scan_points"] = specimen.scan_points
            start = time.process_time()
            use = infer_use(face, patches, evidence, stated, sampling=sampling, **settings)
            row["cpu_s"] = time.process_time() - start
            row |= found_in(use, true)
            if isinstance(evidence, Losses) and use.sizes:
                points = np.array([told, true])
                at = use_pressures(points, face, patches, stated, **settings)
                predicted = predicted_losses(use, evidence, sampling.seed)
                row["told"], row["known"] = (known_error(of, evidence) for of in at)
                row["inferred"] = relative_error(predicted.predicted_um.to_numpy(), evidence)
                row["within_95"] = share_within(predicted)
            if case == "law" and kind == "losses":
                as_it_was = known_use(true, at[1], patches).assign_attrs(
                    use.attrs | {"taken": 1}
                )
                for name, of in (("told", None), ("inferred", use), ("known", as_it_was)):
                    row[f"mcc_{name}"] = mean_mcc(study, of)
            yield row


def found_in(use: xr.Dataset, true: Sequence[float]) -> dict[str, Any]:
    """What was found, beside the truth."""
    row = {f"true_{name}": truth for name, truth in zip(_NAMES, true, strict=True)}
    row["answer"] = use.attrs["answer"]
    if not use.sizes:
        return row
    found, weight = use.assign(log_radius=np.log(use.radius_mm)), use.weight.values
    for name, truth in zip(_NAMES, true, strict=True):
        values = found[name].values
        mean = row[f"mean_{name}"] = weight @ values
        row[f"sd_{name}"] = np.sqrt(weight @ (values - mean) ** 2)
        row[f"below_{name}"] = weight @ (values < truth)
    row["log_score"] = float(use.log_score.sum())
    names = ("effective_draws", "p_value", "gain", "gain_error")
    return row | {name: use.attrs[name] for name in names}


def stone_rows(
    config: Mapping[str, Any], patches: pd.DataFrame, seed: int, cases: Sequence[str]
) -> list[dict[str, Any]]:
    """Those of one stone in some cases."""
    use = drawn_use(config, seed)
    if "outside" in cases:
        use = pushed_outside(config, seed)
        config = merged(config, {"uncertainty": {"load_point_mm": TOLD_OUTSIDE_MM}})
    if "two radii" in cases:
        angle = float(np.random.default_rng([seed, 12]).uniform(0, 180))
        use |= {"worn_radius_mm": two_radii(use["worn_radius_mm"]), "worn_angle_deg": angle}
    config = merged(config, {"specimen": use})
    wears = list(dict.fromkeys(CASES[case].wear for case in cases))
    return [
        row
        for wear, study in specimen_studies(config, patches, seed, wears)
        for row in rows_of(study, seed, [case for case in cases if CASES[case].wear == wear])
    ]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """What the rows of a benchmark show, by case and evidence.

    ``stones``; median errors of the load point along ``y_mm`` and ``x_mm`` and of ``log_radius``;
    ``held_50`` and ``held_95``, percent of these that lie in the middle 50 and 95 % of what was
    found; median errors of the losses, ``told``, ``inferred`` and ``known``; means of ``mcc_told``,
    ``mcc_inferred``, ``mcc_known``, ``within_95`` and ``log_score``; ``claims``, stones whose wear
    a use is said to explain better than heights alone. Where no use made the wear, none is known.
    """
    found = {}
    for (case, kind), of in rows.groupby(["case", "evidence"], sort=False):
        row: dict[str, Any] = {"stones": len(of)}
        if CASES[case].wear == LAW:
            for name in _NAMES:
                row[name] = abs(of[f"mean_{name}"] - of[f"true_{name}"]).median()
            below = of[[f"below_{name}" for name in _NAMES]].to_numpy()
            for share in (50, 95):
                row[f"held_{share}"] = 100 * (abs(below - 0.5) < share / 200).mean()
            row["known"] = of.known.median()
        row |= of[["told", "inferred"]].median().to_dict()
        row |= of[["mcc_told", "mcc_inferred", "mcc_known", "within_95"]].mean().to_dict()
        row["log_score"] = of.log_score.mean()
        found[case, kind] = row | {"claims": (of.answer == BETTER).sum()}
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


def made(file: Path) -> pd.DataFrame:
    """The rows that a file holds already."""
    return read_table(file) if file.exists() else pd.DataFrame({"seed": [], "case": []})


def stones_to_make(
    names: Sequence[str], seeds: range, rows: pd.DataFrame
) -> Iterator[tuple[int, list[str]]]:
    """Seeds, of these, and the cases of each that have no rows."""
    there = set(zip(rows.seed, rows.case, strict=True))
    asked_for: dict[int, list[str]] = {}
    for name in names:
        first, stones = CASES[name].first_seed, CASES[name].stones
        for seed in range(first, first + stones):
            if seed in seeds and (seed, name) not in there:
                asked_for.setdefault(seed, []).append(name)
    yield from sorted(asked_for.items())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--seeds", type=int, nargs=2, default=(5001, 5999), help="these alone")
    parser.add_argument("--fine", action="store_true", help="scans as in config/config.yaml")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=RESULT)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    parser.add_argument("--grades", type=Path, help="write the table of the artefact alone")
    options = parser.parse_args()
    if options.grades:
        config = specimen_config()
        write_grades(config, worn_patches(config), options.grades)
        return
    if not options.tables:
        config = specimen_config()
        if not options.fine:
            config = merged(config, {"specimen": COARSE})
        adds = options.output.exists()
        patches, rows = worn_patches(config), made(options.output)
        first, last = options.seeds
        todo = list(stones_to_make(options.cases, range(first, last + 1), rows))
        # not forked: the transforms' threads would not come along
        context = get_context("spawn")
        with ProcessPoolExecutor(options.processes, mp_context=context) as processes:
            jobs = {processes.submit(stone_rows, config, patches, *of): of for of in todo}
            for number, job in enumerate(as_completed(jobs), start=1):
                if error := job.exception():  # the others' rows are kept
                    print(f"{jobs[job]}: {error!r}", flush=True)
                    continue
                rows = pd.concat([rows, pd.DataFrame(job.result())], ignore_index=True)
                order = rows.case.map(list(CASES).index)
                rows = rows.assign(order=order).sort_values(["order", "seed"], kind="stable")
                rows = rows.drop(columns="order")
                write_table(options.output, rows)
                record(options.output, adds=adds)
                print(f"{number} of {len(jobs)} stones", flush=True)
    print(summary(read_table(options.output)).round(2).T.to_string())


if __name__ == "__main__":
    main()
