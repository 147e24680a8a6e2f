"""Count how often each test claims a relation, over all specimens and at every level.

Inputs: the p-values of each specimen. Outputs: power_p_values.csv, power.csv.
"""

from pathlib import Path

import pandas as pd

from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log
from gstlib.power import rejection_rates


def main(tests: list[Path], p_values: Path, rates: Path) -> None:
    columns = ["seed", "test", "drawn", "wear", "p_value"]
    table = pd.concat([read_table(file, columns) for file in tests], ignore_index=True)
    write_table(p_values, table)
    write_table(rates, rejection_rates(table))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            [Path(file) for file in snakemake.input.tests],
            Path(snakemake.output.p_values),
            Path(snakemake.output.rates),
        )
