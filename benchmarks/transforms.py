"""What ducc0 gains over SciPy's transforms: a cold contact and a path, each both ways in turn.

    .venv/bin/python benchmarks/transforms.py [--repeats 9]

The rough patch of 512² at 76 MPa, as in the cases rough-76 and path-76, on one thread. Rows, CPU
seconds each, go to results/transforms.csv.
"""

import argparse
import os
import time
from pathlib import Path

from age import record

os.environ["OMP_NUM_THREADS"] = "1"

import pandas as pd
from cases import CASES

from gstlib.bem import load_path, solve_contact, transforms
from gstlib.io.tables import write_table

ROWS = Path(__file__).parent / "results/transforms.csv"
MODULUS_MPA, PRESSURE_MPA = 12820.0, 76.0
BY = {"SciPy": False, "ducc0": True}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    surface = CASES["rough-76"].surface
    given = surface.heights(), surface.spacing, MODULUS_MPA
    solve = {
        "rough-76": lambda: solve_contact(*given, mean_pressure=PRESSURE_MPA),
        "path-76": lambda: load_path(*given, target_pressure=PRESSURE_MPA),
    }
    rows = []
    for case, run in solve.items():
        for repeat in range(-1, repeats):  # the first is not counted
            for by, transforms.HAS_DUCC0 in BY.items():
                start = time.process_time()
                run()
                if repeat >= 0:
                    rows.append((case, by, time.process_time() - start))
    table = pd.DataFrame(rows, columns=["case", "transforms", "cpu_s"])
    write_table(ROWS, table)
    record(ROWS)
    median = table.groupby(["case", "transforms"], sort=False).cpu_s.median().unstack()
    print(median.assign(ratio=median.SciPy / median.ducc0).round(3).to_string())


if __name__ == "__main__":
    main()
