"""One measurement is one fresh process; a case is calibration, then rounds over all codes."""

import json
import os
import statistics
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cases import CODES, GOAL
from environments import ENVIRONMENTS, UnavailableError
from evaluate import evaluate
from problems import MODULUS, SCRATCH, Surface

CODES_FOLDER = Path(__file__).parent / "codes"
# Tolerances on the ladder differ by a quarter of a decade, about what one iteration gains; a code
# that is not there after this many tighter ones, or gains less than a tenth by the last two, never
# gets there.
RUNG = 10**0.25
MOST_RUNGS = 16
LEAST_GAIN = 0.9
# Seconds after which a single measurement is given up.
TIME_LIMIT = 1800
# Repeats fall with the time of one: (seconds below which, repeats). What is fast goes on when the
# slow codes are through: a short run that follows a long one of other code is the slower for it.
REPEATS = ((2.0, 15), (15.0, 5), (20.0, 3), (float("inf"), 1))


class RunError(Exception):
    """A runner that crashed or took too long."""


@dataclass(frozen=True)
class Run:
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
    python = ENVIRONMENTS[code.environment].interpreter()
    problem = surface.stored()
    with tempfile.TemporaryDirectory(dir=SCRATCH) as folder:
        task = {
            "problem": str(problem),
            "variant": code.variant,
            "control": code.control,
            "levels": levels[code.control],
            "target_pressure": levels["load"][-1],
            "tolerance": tolerance,
            "threads": 1,
            "fields": f"{folder}/fields.npz",
            "record": f"{folder}/record.json",
        }
        Path(folder, "task.json").write_text(json.dumps(task), encoding="utf-8")
        one = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
        )
        try:
            done = subprocess.run(
                [python, CODES_FOLDER / f"{code.script}.py", f"{folder}/task.json"],
                env={**os.environ, **one},
                capture_output=True,
                text=True,
                timeout=TIME_LIMIT,
            )
        except subprocess.TimeoutExpired:
            raise RunError(f"not done after {TIME_LIMIT} s") from None
        if done.returncode:
            raise RunError((done.stderr.strip().splitlines() or ["no message"])[-1])
        record = json.loads(Path(task["record"]).read_text(encoding="utf-8"))
        with np.load(task["fields"]) as stored:
            pressure = stored["pressure"]
    heights = surface.heights()
    control = code.control
    wanted = levels[code.control]
    if code.environment == "gstlib" and len(wanted) > 1:
        # Our own path chooses its displacements itself: they are part of what it returns.
        control = "displacement"
        wanted = record["displacement"]
    accuracies = [
        evaluate(
            field,
            heights,
            surface.spacing,
            MODULUS,
            load=level if control == "load" else None,
            far_field=level if control == "displacement" else None,
            periodic=surface.periodic,
        )
        for field, level in zip(pressure, wanted, strict=True)
    ]
    names = "cpu", "wall", "peak_mb", "added_mb", "iterations", "convolutions"
    return Run(
        **{name: record[name] for name in names},
        gap_error=max(max(a.gap_error, a.negative_pressure) for a in accuracies),
        force_error=max(accuracy.force_error for accuracy in accuracies),
        contact_fraction=accuracies[-1].contact_fraction,
    )


def levels_of(surface, pressure, steps):
    """The same states for load and for displacement control, from a reference far more accurate."""
    store = SCRATCH / f"{surface.stored().stem}-{pressure:g}MPa-{steps}.json"
    if not store.exists():
        from gstlib.bem import load_path

        path = load_path(
            surface.heights(),
            surface.spacing,
            MODULUS,
            target_pressure=pressure,
            steps=steps,
            periodic=surface.periodic,
            tolerance=1e-11,
        )
        levels = {
            "load": list(path.mean_pressure),
            "displacement": list(path.displacement),
        }
        store.write_text(json.dumps(levels), encoding="utf-8")
    return json.loads(store.read_text(encoding="utf-8"))


class Calibration:
    """The loosest tolerance of each code that reaches the goal, by case; kept in a file.

    A stored tolerance is where the search starts; with `again`, and always for gstlib, which
    changes, looser ones are tried too.
    """

    def __init__(self, path, again):
        self.path, self.again = path, again
        self.tolerances = {}
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines()[1:]:
                case, label, tolerance = line.rsplit(";", 2)
                self.tolerances[case, label] = float(tolerance)

    def find(self, case, code, attempt):
        """Tolerance and its run; ``attempt(tolerance)`` makes one."""
        stored = self.tolerances.get((case, code.label))
        tolerance = stored or code.start
        best = attempt(tolerance)
        if best.reached and (
            stored is None or self.again or code.environment == "gstlib"
        ):
            while (looser := attempt(tolerance * RUNG)).reached:
                tolerance = tolerance * RUNG
                best = looser
        else:
            tried = [(tolerance, best)]
            while not best.reached and len(tried) <= MOST_RUNGS:
                tolerance, best = tolerance / RUNG, attempt(tolerance / RUNG)
                tried.append((tolerance, best))
                stuck = (
                    len(tried) > 2
                    and best.gap_error > LEAST_GAIN * tried[-3][1].gap_error
                )
                if stuck and not best.reached:
                    tolerance, best = tried[-3]
                    break
        self.tolerances[case, code.label] = tolerance
        self._write()
        return tolerance, best

    def _write(self):
        rows = [
            f"{case};{label};{tol:.3g}"
            for (case, label), tol in sorted(self.tolerances.items())
        ]
        text = "\n".join(["case;code;tolerance", *rows]) + "\n"
        self.path.write_text(text, encoding="utf-8")


def measure_case(case, labels, calibration, most_repeats):
    """Rows of the case's table, one for each code."""
    levels = levels_of(case.surface, case.pressure, case.steps)
    entries = []
    for label in labels:
        code = CODES[label]

        def attempt(tolerance, code=code):
            result = run(code, case.surface, levels, tolerance)
            say(case.name, code.label, tolerance, result)
            return result

        try:
            tolerance, first = calibration.find(case.name, code, attempt)
        except (RunError, UnavailableError) as problem:
            print(f"peer {label}: not available ({problem})", flush=True)
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
        print(
            f"{case.name}: round {number + 1} done at {time.strftime('%H:%M:%S')}",
            flush=True,
        )
    rows = [row(*entry) for entry in entries if entry[-1]]
    own = next((r["cpu_median"] for r in rows if r["code"] == "gstlib, load"), None)
    for r in rows:
        r["ratio"] = r["cpu_median"] / own if own else ""
    return rows


# Of several runs, the largest counts.
LARGEST = "peak_mb", "added_mb", "gap_error", "force_error"


def row(code, tolerance, _, runs):
    return {
        "code": code.label,
        "control": code.control,
        "cpu_median": statistics.median(run.cpu for run in runs),
        "cpu_min": min(run.cpu for run in runs),
        "ratio": "",
        "wall_median": statistics.median(run.wall for run in runs),
        "wall_min": min(run.wall for run in runs),
        "iterations": runs[0].iterations,
        "convolutions": runs[0].convolutions,
        **{name: max(getattr(run, name) for run in runs) for name in LARGEST},
        "contact_fraction": runs[0].contact_fraction,
        "tolerance": tolerance,
        "reached": "yes" if all(run.reached for run in runs) else "no",
        "runs": len(runs),
    }


def measure_growth(case, runs, calibration, keep):
    """Rows, one for each code, size and seed; `keep` stores them after each."""
    rows = []
    reached = {}
    for label, sizes, seeds, cut_off in runs:
        code = CODES[label]
        first = calibration.tolerances.get(("rough-76", label), code.start)
        for size in sizes:
            for seed in seeds:
                surface = Surface("rough", size, seed, cut_off)
                try:
                    levels = {"load": [case.pressure]}
                    if code.control == "displacement":
                        levels = levels_of(surface, case.pressure, 1)
                    tolerance = reached.get((label, seed, cut_off), first)
                    for _ in range(8):
                        result = run(code, surface, levels, tolerance)
                        say(
                            f"{case.name} {size}² seed {seed}", label, tolerance, result
                        )
                        if result.reached:
                            # a finer grid starts with what the coarser one needed
                            reached[label, seed, cut_off] = tolerance
                            break
                        tolerance /= RUNG
                    else:
                        tolerance *= RUNG
                except (RunError, UnavailableError) as problem:
                    print(f"peer {label}: not available ({problem})", flush=True)
                    continue
                entry = row(code, tolerance, 1, [result])
                rows.append({"size": size, "seed": seed, "cut_off": cut_off, **entry})
                keep(rows)
    return rows


def say(case, label, tolerance, result):
    print(
        f"{case}: {label}, tolerance {tolerance:.1e}: CPU {result.cpu:.2f} s, gap error "
        f"{result.gap_error:.1e}{'' if result.reached else ' (missed)'}",
        flush=True,
    )
