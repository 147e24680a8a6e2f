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


def margins(before, after):
    """A row for each table of two result folders."""
    changes = compare_results(before, after)
    for file in sorted((before / "tables").glob("*.csv")):
        cells = pd.read_csv(file, dtype=str, keep_default_na=False).stack()
        values = pd.to_numeric(cells, errors="coerce").dropna()
        of_table = changes[changes.table == file.name]
        numbers = of_table.dropna(subset="relative")
        columns = TABLES[file.stem].columns
        digits = numbers.column.map({name: columns[name].digits for name in columns})
        first, second = numbers.before.astype(float), numbers.after.astype(float)
        largest = np.maximum(first.abs(), second.abs())
        # differences in units of the last of so many significant digits
        moved = (second - first).abs() / 10 ** (
            np.floor(np.log10(largest)) + 1 - digits
        )
        changed = sum(
            printed(one, shown) != printed(other, shown)
            for one, other, shown in zip(first, second, digits, strict=True)
        )
        yield {
            "table": file.name,
            "values": int((values % 1 != 0).sum()),
            "different": len(numbers),
            "largest_relative": numbers.relative.max() if len(numbers) else 0.0,
            "margin": 0.5 / moved.max() if len(numbers) else math.inf,
            "expected_changes": moved.sum(),
            "changes": len(of_table) - len(numbers) + changed,
        }


def main():
    chosen = options(__doc__, ROWS, config="config/config.yaml")
    if not chosen.tables:
        extensions = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
        older = {
            "NPY_DISABLE_CPU_FEATURES": " ".join(extensions),
            "OPENBLAS_CORETYPE": "Prescott",
        }
        runs = {"2 cores": (2, {}), "1 core": (1, {}), "older processor": (1, older)}
        with tempfile.TemporaryDirectory() as name:
            first, *others = (
                run_study(
                    Path(name) / run, chosen.config, cores, {ALL_DIGITS: "1"} | more
                )
                for run, (cores, more) in runs.items()
            )
            rows = [
                {"run": run} | row
                for run, results in zip([*runs][1:], others, strict=True)
                for row in margins(first, results)
            ]
        save(chosen.output, pd.DataFrame(rows), digits=2)
    print(chosen.output.read_text("utf-8"))


if __name__ == "__main__":
    main()
