"""Count how often each test claims a relation, over all specimens and at every level."""

from pathlib import Path

import pandas as pd
from gstlib.power import rejection_rates

from gst.logs import run_script
from gstlib.io.tables import read_table, write_table


def main(tests: list[Path], p_values: Path, rates: Path) -> None:
    columns = ["seed", "test", "drawn", "wear", "p_value"]
    table = pd.concat([read_table(file, columns) for file in tests], ignore_index=True)
    write_table(p_values, table)
    write_table(rates, rejection_rates(table))


if "snakemake" in globals():
    run_script(snakemake, main)
