"""Speed and accuracy of gstlib.bem against other contact codes: ``python benchmarks/run.py``.

Makes each code's environment on first use, measures the cases one after the other, and rewrites
results/ and the tables in README.md after each of them: a run that stops can be gone on with by
naming the cases that are left. `--codes` has parts of the names of the codes that are measured, and
`--repeats` how often at most.
"""

import json

import pandas as pd
from age import record
from cases import CASES, CODES, Growth
from environments import UnavailableError, interpreter
from machine import describe
from measure import Calibration, measure_case, measure_growth
from report import write_report
from runner import RESULTS, options


def main():
    chosen = options(
        __doc__,
        RESULTS,
        case={"nargs": "+", "choices": CASES, "default": [*CASES]},
        codes=[""],
        repeats=15,
    )
    cases = [CASES[name] for name in chosen.case]
    if not chosen.tables:
        available = check_environments(chosen.output / "machine.json")
        calibration = Calibration(chosen.output / "calibration.csv")
        for case in cases:
            print(f"\n{case.title}", flush=True)
            measure(case, chosen, available, calibration)
            write_report(chosen.output)
    write_report(chosen.output)


def measure(case, chosen, available, calibration):
    path = chosen.output / f"{case.name}.csv"
    parts = [part.lower() for part in chosen.codes]

    def wanted(label):
        is_chosen = any(part in label.lower() for part in parts)
        return is_chosen and CODES[label].environment in available

    if isinstance(case, Growth):
        grids = [grids for grids in case.runs if wanted(grids.code)]
        for rows in measure_growth(case, grids, calibration):
            write_table(path, rows)
        return
    labels = list(filter(wanted, case.codes))
    if rows := measure_case(case, labels, calibration, chosen.repeats):
        write_table(path, rows)


def check_environments(path):
    """Environments that can be used, described in a file; prints which cannot, and why."""
    available = []
    for name in dict.fromkeys(code.environment for code in CODES.values()):
        try:
            interpreter(name)
            available.append(name)
        except UnavailableError as problem:
            print(f"peer {name}: not available ({problem})", flush=True)
    machine = describe(available)
    if path.exists():
        # Tables of cases that are not measured this time still stand.
        machine["codes"] = (
            json.loads(path.read_text("utf-8"))["codes"] | machine["codes"]
        )
    path.write_text(json.dumps(machine, indent=2) + "\n", encoding="utf-8")
    return available


def write_table(path, rows):
    """Rows as CSV, rounded to the digits that mean something."""
    table = pd.DataFrame(rows).convert_dtypes()
    for name in table.select_dtypes("Float64"):
        digits = 2 if name.endswith("_error") else 3
        shown = "{:.0f}" if name.endswith("_mb") else f"{{:.{digits}g}}"
        table[name] = table[name].astype(object).map(shown.format, na_action="ignore")
    table.to_csv(path, index=False, lineterminator="\n")
    record(path)


if __name__ == "__main__":
    main()
