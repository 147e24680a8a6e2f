"""Where does the time of a study go, and how much of it is starting interpreters?

    python benchmarks/study.py [--config config/config.yaml] [--cores 2] [--repeats 5]

Runs the study from nothing in a folder of its own, and writes benchmarks/results/study.csv (with
--output: elsewhere), one row for each rule:

jobs       how many ran;
wall_s     their wall times together, as Snakemake's `benchmark` measured them;
cpu_s      their CPU times together;
start_s    of these, starting: interpreter and imports;
start_fraction  start_s / cpu_s.

Each interpreter of the study notes at its end its CPU time and which modules it had loaded, so that
imports made late or by chance count too. Starting is then measured bare: as many interpreters at a
time as the study has cores import just these modules, `repeats` times; the median of their CPU
times counts. CPU times, as starting does nothing but compute, and as what else the machine does
disturbs them less than wall times: on a quiet machine a job's two times are nearly the same. The
row `snakemake` is Snakemake's own process: its wall is the study's. The row `all` is all jobs
together.
"""

import json
import os
import platform
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from functools import partial
from pathlib import Path

import pandas as pd
from commands import run_study
from runner import RESULTS, options

# Put on the path of every interpreter of the study: at its end it writes down what it used.
NOTE_USE = """
import atexit, json, os, sys, time

def note():
    job = getattr(sys.modules["__main__"], "snakemake", None)
    rule = getattr(job, "rule", "snakemake")
    modules = [name for name in sys.modules if name != "__main__"]
    path = os.path.join(os.environ["STUDY_NOTES"], f"{rule}.{os.getpid()}.json")
    with open(path, "w") as file:
        json.dump({"modules": modules, "cpu_s": time.process_time()}, file)

atexit.register(note)
"""
IMPORT_MODULES = """
import importlib, json, sys

for name in json.load(open(sys.argv[1])):
    try:
        importlib.import_module(name)
    except Exception:  # parts of packages that are not modules of their own
        pass
"""


def noted_study(folder, config, cores):
    """Run the study in `folder`.

    Returns its wall time (s), its results, and of each rule the CPU time (s) and the modules of
    its interpreters.
    """
    notes = folder / "notes"
    hook = folder / "hook"
    notes.mkdir()
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(NOTE_USE)
    path = os.pathsep.join(filter(None, [str(hook), os.environ.get("PYTHONPATH")]))
    start = time.perf_counter()
    results = run_study(
        folder, config, cores, {"PYTHONPATH": path, "STUDY_NOTES": str(notes)}
    )
    wall = time.perf_counter() - start
    cpu_s = defaultdict(float)
    modules = defaultdict(list)
    for file in sorted(notes.glob("*.json")):
        note = json.loads(file.read_text())
        rule = file.name.split(".")[0]
        cpu_s[rule] += note["cpu_s"]
        modules[rule] = max(modules[rule], note["modules"], key=len)
    return wall, results, cpu_s, modules


def job_walls(results, rules):
    """Wall times (s) of the jobs of each rule, from their logs: their names begin with it."""
    walls = defaultdict(list)
    for file in sorted((results / "logs").rglob("*.log")):
        name = file.relative_to(results / "logs").parts[0].removesuffix(".log")
        rule = max(
            (each for each in rules if f"{name}_".startswith(f"{each}_")), key=len
        )
        took = re.findall(
            r"^INFO took ([0-9.]+) s,", file.read_text("utf-8"), re.MULTILINE
        )
        walls[rule] += [float(wall) for wall in took]
    return walls


def start_time(modules, *, cores, repeats, folder):
    """Median time (s) of an interpreter that imports the modules, `cores` at a time.

    CPU time: starting does nothing but compute, and what else the machine does disturbs it less.
    """
    names = folder / "names.json"
    names.write_text(json.dumps(modules))
    command = [sys.executable, "-c", IMPORT_MODULES, str(names)]
    one_thread = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    times = []
    for _ in range(repeats):
        together = [
            subprocess.Popen(command, stderr=subprocess.DEVNULL, env=one_thread)
            for _ in range(cores)
        ]
        for process in together:
            _, process.returncode, used = os.wait4(process.pid, 0)
            times.append(used.ru_utime + used.ru_stime)
    return statistics.median(times)


def main():
    chosen = options(
        __doc__, RESULTS / "study.csv", config="config/config.yaml", cores=2, repeats=5
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wall, results, cpu_s, modules = noted_study(folder, chosen.config, chosen.cores)
        measure = partial(start_time, repeats=chosen.repeats, folder=folder)
        rows = [
            (rule, len(walls), sum(walls), cpu_s[rule], len(walls) * start)
            for rule, walls in job_walls(results, set(cpu_s)).items()
            for start in [measure(modules[rule], cores=chosen.cores)]
        ]
        own = measure(modules["snakemake"], cores=1)
    table = pd.DataFrame(rows, columns=["rule", "jobs", "wall_s", "cpu_s", "start_s"])
    table = table.sort_values("cpu_s", ascending=False)
    every = table.drop(columns="rule").sum()
    table.loc[len(table)] = [
        "all",
        int(every.jobs),
        every.wall_s,
        every.cpu_s,
        every.start_s,
    ]
    table.loc[len(table)] = ["snakemake", 1, wall, cpu_s["snakemake"], own]
    table["start_fraction"] = table.start_s / table.cpu_s
    header = (
        f"# {chosen.config} on {chosen.cores} cores of {os.cpu_count()} "
        f"({platform.machine()}, Python {platform.python_version()}): wall {wall:.1f} s; starting "
        f"interpreters is {every.start_s / every.cpu_s:.1%} of the jobs' CPU time, and with "
        f"Snakemake's own {(every.start_s + own) / (chosen.cores * wall):.1%} of cores x wall\n"
    )
    text = header + table.to_csv(index=False, float_format="%.3f", lineterminator="\n")
    chosen.output.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
