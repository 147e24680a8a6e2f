"""Gather the microscale contacts into two tables.

The residual stands there as the power of ten that it is below: its digits are rounding, other ones
on every processor. So may be the number of iterations, which is left to the contacts' files.

Inputs: the patches' contacts. Outputs: microscale_summary.csv, microscale_paths.csv.
Settings: the patches, in order.
"""

import math
from pathlib import Path

import pandas as pd

from gstlib.contact import load_path_table
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log

SUMMARY = [
    "patch",
    "target_pressure_MPa",
    "mean_pressure_MPa",
    "displacement_um",
    "contact_fraction",
    "stiffness_MPa_per_um",
    "residual",
]
PATH = [
    "patch",
    "step",
    "displacement_um",
    "mean_pressure_MPa",
    "contact_fraction",
    "stiffness_MPa_per_um",
]


def power_of_ten_above(value: float) -> float:
    return 10.0 ** math.ceil(math.log10(value)) if value > 0 else 0.0


def main(contacts: dict[str, Path], summary: Path, paths: Path) -> None:
    finals, tables = [], []
    for patch, file in contacts.items():
        contact = read_dataset(file)
        table = load_path_table(contact).assign(patch=patch)
        tables.append(table)
        finals.append(
            table.iloc[-1].to_dict()
            | {
                "target_pressure_MPa": contact.attrs["target_pressure_MPa"],
                "residual": power_of_ten_above(float(contact.residual[-1])),
            }
        )
    write_table(summary, pd.DataFrame(finals, columns=SUMMARY))
    write_table(paths, pd.concat(tables)[PATH])


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.patches, map(Path, snakemake.input.contacts), strict=True)),
            Path(snakemake.output.summary),
            Path(snakemake.output.paths),
        )
