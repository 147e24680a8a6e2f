"""One measurement is one fresh process; a case is calibration, then rounds over all codes."""

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from cases import CODES, GOAL
from environments import interpreter
from evaluate import evaluate
from problems import MODULUS, Surface

from gstlib.bem import load_path

CODES_FOLDER = Path(__file__).parent / "codes"
# Tolerances on the ladder differ by a quarter of a decade, about what one iteration gains; a code
# that is not there after this many tighter ones, or gains less than a tenth by the last two, never
# gets there. The search of a code that has none starts at `LOOSEST`.
RUNG = 10**0.25
LOOSEST = 1e-9
MOST_RUNGS = 16
LEAST_GAIN = 0.9
# Seconds after which a single measurement is given up.
TIME_LIMIT = 1800
# Repeats fall with the time of one: (seconds below which, repeats). What is fast goes on when the
# slow codes are through: a short run that follows a long one of other code is the slower for it.
REPEATS = ((2.0, 15), (15.0, 5), (20.0, 3), (float("inf"), 1))
# Of several runs, the largest counts.
LARGEST = ["peak_mb", "added_mb", "gap_error", "force_error"]


class RunError(Exception):
    """A runner that crashed or took too long."""


class Run(NamedTuple):
    """One measurement, with the accuracy that our evaluator finds; worst over the levels."""

    cpu: float
    wall: float
    peak_mb: float
    added_mb: float
    iterations: int | None
    convolutions: int | None
    gap_error: float
    force_error: float
    contact_fraction: float

    @property
    def reached(self):
        # NaN, under displacement control, is no error of the force.
        return self.gap_error <= GOAL and not self.force_error > GOAL


def run(code, surface, levels, tolerance):
    """Solve once in a process of its own, and evaluate what it returns."""
    wanted, control = levels[code.control], code.control
    with tempfile.TemporaryDirectory() as folder:
        task = {
            "variant": code.variant,
            "control": control,
            "levels": wanted,
            "target_pressure": levels["load"][-1],
            "tolerance": tolerance,
            "threads": 1,
        }
        surface.store(f"{folder}/problem.npz")
        Path(folder, "task.json").write_text(json.dumps(task), encoding="utf-8")
        solve(code, folder)
        record = json.loads(Path(folder, "record.json").read_text(encoding="utf-8"))
        with np.load(f"{folder}/fields.npz") as stored:
            pressure = stored["pressure"]
    if "displacement" in record and len(wanted) > 1:
        # Our own path chooses its displacements itself: they are part of what it returns.
        wanted, control = record.pop("displacement"), "displacement"
    problem = surface.heights(), surface.spacing, MODULUS
    prescribed = {"displacement": "far_field"}.get(control, control)
    accuracies = [
        evaluate(field, *problem, periodic=surface.periodic, **{prescribed: level})
        for field, level in zip(pressure, wanted, strict=True)
    ]
    return Run(
        **{name: record[name] for name in Run._fields[:6]},
        gap_error=max(max(a.gap_error, a.negative_pressure) for a in accuracies),
        force_error=max(accuracy.force_error for accuracy in accuracies),
        contact_fraction=accuracies[-1].contact_fraction,
    )


def solve(code, folder):
    """Run a code on the task in a folder."""
    script = CODES_FOLDER / f"run_{code.environment}.py"
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    try:
        done = subprocess.run(
            [interpreter(code.environment), script, folder],
            env=os.environ | dict.fromkeys(threads, "1"),
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        raise RunError(f"not done after {TIME_LIMIT} s") from None
    if done.returncode:
        raise RunError((done.stderr.strip().splitlines() or ["no message"])[-1])


def levels_of(surface, pressure, steps):
    """The same states for load and for displacement control, from a reference far more accurate."""
    path = load_path(
        surface.heights(),
        surface.spacing,
        MODULUS,
        target_pressure=pressure,
        steps=steps,
        periodic=surface.periodic,
        tolerance=1e-11,
    )
    return {"load": list(path.mean_pressure), "displacement": list(path.displacement)}


def tightened(tolerance, attempt):
    """The loosest of ever tighter tolerances that reaches the goal, and its run.

    ``attempt(tolerance)`` makes a run. A code that gains nothing keeps the tolerance from which on
    it does not.
    """
    tried = [(tolerance, attempt(tolerance))]
    while not tried[-1][1].reached and len(tried) <= MOST_RUNGS:
        tolerance /= RUNG
        tried.append((tolerance, attempt(tolerance)))
        before, now = (each.gap_error for _, each in (tried[-3:][0], tried[-1]))
        is_stuck = len(tried) > 2 and now > LEAST_GAIN * before
        if is_stuck and not tried[-1][1].reached:
            return tried[-3]
    return tried[-1]


class Calibration:
    """The loosest tolerance of each code that reaches the goal, by case; kept in a file.

    A stored tolerance is where the search starts; for gstlib, which changes, looser ones are tried
    too.
    """

    def __init__(self, path):
        self.path = path
        self.tolerances = {}
        if path.exists():
            stored = pd.read_csv(path, sep=";", index_col=["case", "code"])
            self.tolerances = stored.tolerance.to_dict()

    def find(self, case, code, attempt):
        """Tolerance and its run; ``attempt(tolerance)`` makes one."""
        stored = self.tolerances.get((case, code.label))
        tolerance, best = tightened(stored or LOOSEST, attempt)
        is_first = tolerance == (stored or LOOSEST)
        if is_first and (stored is None or code.environment == "gstlib"):
            while best.reached and (looser := attempt(tolerance * RUNG)).reached:
                tolerance, best = tolerance * RUNG, looser
        self.tolerances[case, code.label] = tolerance
        table = pd.Series(self.tolerances, name="tolerance").sort_index()
        table = table.rename_axis(["case", "code"])
        table.to_csv(self.path, sep=";", float_format="%.3g")
        return tolerance, best


def attempts(name, code, surface, levels):
    """Runs of a code by their tolerance, each with a line of what it reached."""

    def attempt(tolerance):
        result = run(code, surface, levels, tolerance)
        print(
            f"{name}: {code.label}, tolerance {tolerance:.1e}: CPU {result.cpu:.2f} s, "
            f"gap error {result.gap_error:.1e}{'' if result.reached else ' (missed)'}",
            flush=True,
        )
        return result

    return attempt


def measure_case(case, labels, calibration, most_repeats):
    """Rows of the case's table, one for each code."""
    levels = levels_of(case.surface, case.pressure, case.steps)
    entries = []
    for code in map(CODES.get, labels):
        attempt = attempts(case.name, code, case.surface, levels)
        try:
            tolerance, first = calibration.find(case.name, code, attempt)
        except RunError as problem:
            print(f"peer {code.label}: not available ({problem})", flush=True)
            continue
        repeats = next(count for limit, count in REPEATS if first.wall < limit)
        entries.append((code, tolerance, min(repeats, most_repeats), []))
    for number in range(max((entry[2] for entry in entries), default=0)):
        for code, tolerance, repeats, runs in entries:
            if number < repeats:
                try:
                    runs.append(run(code, case.surface, levels, tolerance))
                except RunError as problem:
                    print(f"{code.label}: {problem}", flush=True)
        now = time.strftime("%H:%M:%S")
        print(f"{case.name}: round {number + 1} done at {now}", flush=True)
    rows = [row(code, tolerance, runs) for code, tolerance, _, runs in entries if runs]
    own = next((r["cpu_median"] for r in rows if r["code"] == "gstlib, load"), None)
    for r in rows:
        r["ratio"] = r["cpu_median"] / own if own else None
    return rows


def row(code, tolerance, runs):
    """The row of a code with these runs."""
    table = pd.DataFrame(runs)
    return {
        "code": code.label,
        "control": code.control,
        "cpu_median": table.cpu.median(),
        "cpu_min": table.cpu.min(),
        "ratio": None,
        "wall_median": table.wall.median(),
        "wall_min": table.wall.min(),
        "iterations": runs[0].iterations,
        "convolutions": runs[0].convolutions,
        **table[LARGEST].max(),
        "contact_fraction": runs[0].contact_fraction,
        "tolerance": tolerance,
        "reached": "yes" if all(run.reached for run in runs) else "no",
        "runs": len(runs),
    }


def measure_growth(case, runs, calibration):
    """Measure each code, size and seed; the rows so far after each."""
    rows = []
    reached = {}
    tasks = (
        (label, Surface("rough", size, seed, cut_off))
        for label, sizes, seeds, cut_off in runs
        for size in sizes
        for seed in seeds
    )
    for label, surface in tasks:
        code = CODES[label]
        _, size, seed, cut_off, _ = surface
        # a finer grid starts with what the coarser one needed
        first = calibration.tolerances.get(("rough-76", label), LOOSEST)
        tolerance = reached.get((label, seed, cut_off), first)
        levels = {"load": [case.pressure]}
        if code.control == "displacement":
            levels = levels_of(surface, case.pressure, 1)
        attempt = attempts(f"{case.name} {size}² seed {seed}", code, surface, levels)
        try:
            tolerance, result = tightened(tolerance, attempt)
        except RunError as problem:
            print(f"peer {label}: not available ({problem})", flush=True)
            continue
        reached[label, seed, cut_off] = tolerance
        entry = row(code, tolerance, [result])
        rows.append({"size": size, "seed": seed, "cut_off": cut_off, **entry})
        yield rows
