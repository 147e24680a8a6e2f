"""Set the published figures beside the computed ones."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.tables import columns_of, write_table
from gstlib.errors import InputError
from gstlib.io.tables import read_pressures, read_table


def main(published: Path, path: Path, pressures: Path, table: Path) -> None:
    """`published` is a CSV of quantity, patch, unit, value; `path` that of the macroscale."""
    final = read_table(path).iloc[-1]
    computed = {
        ("displacement", ""): final.displacement_um,
        ("mean pressure", ""): final.mean_pressure_MPa,
        ("contact fraction", ""): final.contact_fraction,
    }
    for row in read_pressures(pressures).itertuples():
        computed["patch pressure", row.patch] = row.pressure_MPa
    given = pd.read_csv(
        published,
        dtype={"patch": str},
        comment="#",
        keep_default_na=False,
        na_values={"value": ""},
    )
    keys = list(zip(given.quantity, given.patch, strict=True))
    if unknown := [key for key in keys if key not in computed]:
        raise InputError(
            published,
            f"names quantities or patches that the study does not have: {unknown}",
            f"Quantities are {sorted({quantity for quantity, _ in computed})}; patches are those "
            "of the patch table.",
        )
    values = [float(computed[key]) for key in keys]
    given = given.rename(columns={"value": "published"}).astype({"published": float})
    write_table(table, given.assign(computed=values)[columns_of("published")])


if "snakemake" in globals():
    run_script(snakemake, main)
