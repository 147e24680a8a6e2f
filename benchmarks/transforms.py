"""What ducc0 gains over SciPy's transforms: a cold contact and a path, each both ways in turn.

    .venv/bin/python benchmarks/transforms.py [--repeats 9]

The rough patch of 512² at 76 MPa, as in the cases rough-76 and path-76, on one thread. Rows, CPU
seconds each, go to results/transforms.csv.
"""

import os
import time

os.environ["OMP_NUM_THREADS"] = "1"

import pandas as pd
from cases import CASES
from problems import MODULUS
from runner import RESULTS, run_script

from gstlib.bem import load_path, solve_contact, transforms

ROWS = RESULTS / "transforms.csv"
BY = {"SciPy": False, "ducc0": True}


def measured(chosen):
    """A row for each problem, library and repeat."""
    case = CASES["rough-76"]
    problem = case.surface.heights(), case.surface.spacing, MODULUS
    solve = {
        "rough-76": lambda: solve_contact(*problem, mean_pressure=case.pressure),
        "path-76": lambda: load_path(*problem, target_pressure=case.pressure),
    }
    rows = []
    for name, run in solve.items():
        for repeat in range(-1, chosen.repeats):  # the first is not counted
            for by, transforms.HAS_DUCC0 in BY.items():
                start = time.process_time()
                run()
                if repeat >= 0:
                    rows.append((name, by, time.process_time() - start))
    yield pd.DataFrame(rows, columns=["case", "transforms", "cpu_s"])


def ratios(table):
    """Medians of both, and by how much SciPy takes longer."""
    median = table.groupby(["case", "transforms"], sort=False).cpu_s.median().unstack()
    return median.assign(ratio=median.SciPy / median.ducc0)


if __name__ == "__main__":
    run_script(
        __doc__,
        ROWS,
        measured,
        lambda rows: ratios(rows).round(3).to_string(),
        repeats=9,
    )
