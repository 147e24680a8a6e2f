"""Speed and accuracy of gstlib.bem against other contact codes: ``python benchmarks/run.py``.

Makes each code's environment on first use, measures the cases one after the other, and rewrites
results/, the tables in README.md and the figure after each of them: a run that stops can be gone on
with by naming the cases that are left.
"""

import argparse
import csv
import json
import math
import time

from age import record
from cases import CASES, CODES, Growth
from environments import ENVIRONMENTS, UnavailableError
from machine import describe
from measure import Calibration, measure_case, measure_growth
from report import write_report
from runner import RESULTS


def main():
    chosen = arguments()
    cases = [CASES[name] for name in chosen.case or CASES]
    if not chosen.report:
        start = time.monotonic()
        available = check_environments(cases, chosen)
        calibration = Calibration(RESULTS / "calibration.csv", chosen.calibrate)
        for case in cases:
            print(f"\n{case.title}", flush=True)
            measure(case, chosen, available, calibration)
            write_report(RESULTS)
        print(f"\n{(time.monotonic() - start) / 60:.1f} minutes", flush=True)
    write_report(RESULTS)


def measure(case, chosen, available, calibration):
    path = RESULTS / f"{case.name}.csv"
    parts = [part.lower() for part in chosen.codes]

    def wanted(label):
        is_chosen = any(part in label.lower() for part in parts)
        return is_chosen and CODES[label].environment in available

    if isinstance(case, Growth):
        grids = [grids for grids in entries(case, chosen) if wanted(grids.code)]
        measure_growth(case, grids, calibration, lambda rows: write_table(path, rows))
    else:
        labels = list(filter(wanted, entries(case, chosen)))
        rows = measure_case(case, labels, calibration, chosen.repeats)
        if rows:
            write_table(path, rows)


def entries(case, chosen):
    """What is measured in a case: labels of codes, or `Grids`."""
    of_case = case.runs if isinstance(case, Growth) else case.codes
    return of_case + (case.more if chosen.all else ())


def check_environments(cases, chosen):
    """Environments that can be used; says which cannot, and why."""
    every = [entry for case in cases for entry in entries(case, chosen)]
    needed = {CODES[getattr(entry, "code", entry)].environment for entry in every}
    available = []
    for name in filter(needed.__contains__, ENVIRONMENTS):
        try:
            ENVIRONMENTS[name].interpreter()
            available.append(name)
        except UnavailableError as problem:
            print(f"peer {name}: not available ({problem})", flush=True)
    path = RESULTS / "machine.json"
    machine = describe(available)
    if path.exists():
        # Tables of cases that are not measured this time still stand.
        earlier = json.loads(path.read_text(encoding="utf-8"))
        machine["codes"] = {**earlier["codes"], **machine["codes"]}
    path.write_text(json.dumps(machine, indent=2) + "\n", encoding="utf-8")
    return available


def write_table(path, rows):
    """Rows as CSV, rounded to the digits that mean something."""

    def rounded(key, value):
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        if not isinstance(value, float):
            return value
        if key.endswith("_mb"):
            return round(value)
        digits = 2 if key.endswith("_error") else 3
        return f"{value:.{digits}g}"

    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {key: rounded(key, value) for key, value in r.items()} for r in rows
        )
    record(path)


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", nargs="+", choices=CASES, help="only these cases")
    parser.add_argument(
        "--codes",
        nargs="+",
        default=[""],
        help="only codes whose name holds one of these",
    )
    parser.add_argument(
        "--repeats", type=int, default=15, help="at most so many (default 15)"
    )
    parser.add_argument(
        "--all", action="store_true", help="slow codes and sizes, other builds too"
    )
    parser.add_argument(
        "--calibrate", action="store_true", help="search all tolerances afresh"
    )
    parser.add_argument("--report", action="store_true", help="tables and figure only")
    return parser.parse_args()


if __name__ == "__main__":
    main()
