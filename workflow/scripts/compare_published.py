"""Set the published figures beside the computed ones.

Inputs: the CSV of published figures (quantity, patch, unit, value), macroscale_path.csv,
patch_pressures.csv. Outputs: published.csv. Settings: none.
"""

from pathlib import Path

import pandas as pd

from gstlib.errors import InputError
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log


def main(published: Path, path: Path, pressures: Path, table: Path) -> None:
    final = read_table(path, ["displacement_um", "mean_pressure_MPa", "contact_fraction"]).iloc[-1]
    by_patch = read_table(pressures, ["patch", "pressure_MPa"]).set_index("patch").pressure_MPa
    computed = {
        ("displacement", ""): final.displacement_um,
        ("mean pressure", ""): final.mean_pressure_MPa,
        ("contact fraction", ""): final.contact_fraction,
        **{("patch pressure", patch): value for patch, value in by_patch.items()},
    }
    given = pd.read_csv(published, dtype={"patch": str}, comment="#").fillna({"patch": ""})
    keys = list(zip(given.quantity, given.patch, strict=True))
    unknown = [key for key in keys if key not in computed]
    if unknown:
        raise InputError(
            published,
            f"names quantities or patches that the study does not have: {unknown}",
            f"Quantities are {sorted({quantity for quantity, _ in computed})}; patches are those "
            "of the patch table.",
        )
    write_table(
        table,
        pd.DataFrame(
            {
                "quantity": given.quantity,
                "patch": given.patch,
                "unit": given.unit,
                "published": given.value.astype(float),
                "computed": [float(computed[key]) for key in keys],
            }
        ),
    )


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.published),
            Path(snakemake.input.path),
            Path(snakemake.input.pressures),
            Path(snakemake.output.table),
        )
