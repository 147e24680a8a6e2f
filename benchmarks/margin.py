"""By how much do a study's tables differ from run to run, beneath the digits that are printed?

    python benchmarks/margin.py [--config config/config.yaml]

Runs the study three times from nothing, each in a folder of its own and with every digit printed:
on 2 cores; on 1 core; and on 1 core with the instructions of an older processor only, whose sums
and functions differ in their last bits, as those of another machine do. Writes
benchmarks/results/margin.csv (with --output: elsewhere), a row for each of the latter two and each
table, held against the first:

values             numbers in the table that are no whole ones;
different          of these, how many differ in any digit;
largest_relative   largest difference over the value;
margin             half a unit of the last digit that is printed, over the difference: the least;
expected_changes   how many printed numbers would differ, if their next digits were drawn by chance:
                   the sum of the differences in units of the last printed digit;
changes            how many printed numbers and words do differ.

Between the stages, too, all digits are handed on here. In a study of a user they are rounded in the
tables, so that differences grow less.
"""

import math
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from commands import run_study
from runner import RESULTS, options, save

from gst.config.tables import TABLES
from gst.share.difference import compare_results
from gstlib.io.tables import ALL_DIGITS, printed

ROWS = RESULTS / "margin.csv"
RUNS = {"2 cores": 2, "1 core": 1, "older processor": 1}


def older_processor():
    """Environment in which NumPy and OpenBLAS use what every processor of the kind has."""
    extensions = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return {
        "NPY_DISABLE_CPU_FEATURES": " ".join(extensions),
        "OPENBLAS_CORETYPE": "Prescott",
    }


def last_unit(value, digits):
    """A unit of the last of so many significant digits."""
    return 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits)


def margins(before, after):
    """A row for each table of two result folders."""
    changes = compare_results(before, after)
    for file in sorted((before / "tables").glob("*.csv")):
        of_table = changes[changes.table == file.name]
        columns = TABLES[file.stem].columns
        numbers = of_table.dropna(subset="relative")
        moved = []
        changed = len(of_table) - len(numbers)
        for change in numbers.itertuples():
            digits = columns[change.column].digits
            one = float(change.before)
            other = float(change.after)
            moved.append(abs(other - one) / last_unit(max(one, other, key=abs), digits))
            changed += printed(one, digits) != printed(other, digits)
        yield {
            "table": file.name,
            "values": count_values(file),
            "different": len(numbers),
            "largest_relative": numbers.relative.max() if len(numbers) else 0.0,
            "margin": 0.5 / max(moved) if moved else math.inf,
            "expected_changes": sum(moved),
            "changes": changed,
        }


def count_values(file):
    """Numbers in a table that are no whole ones."""
    cells = pd.read_csv(file, dtype=str, keep_default_na=False).to_numpy().ravel()
    numbers = pd.to_numeric(pd.Series(cells), errors="coerce").dropna()
    return int((numbers % 1 != 0).sum())


def main():
    chosen = options(__doc__, ROWS, config="config/config.yaml")
    if not chosen.tables:
        with tempfile.TemporaryDirectory() as name:
            results = {}
            for run, cores in RUNS.items():
                folder = Path(name) / run.replace(" ", "_")
                environment = older_processor() if run == "older processor" else {}
                environment |= {ALL_DIGITS: "1"}
                results[run] = run_study(folder, chosen.config, cores, environment)
            first, *others = RUNS
            tables = {run: margins(results[first], results[run]) for run in others}
            rows = [
                {"run": run} | row for run, table in tables.items() for row in table
            ]
        save(chosen.output, pd.DataFrame(rows), digits=2)
    print(chosen.output.read_text("utf-8"))


if __name__ == "__main__":
    main()
