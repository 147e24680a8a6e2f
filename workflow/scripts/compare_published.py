"""Set the published figures beside the computed ones."""

from pathlib import Path

from gst.logs import run_script
from gst.tables import columns_of, write_table
from gst.user_tables import read_rows
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
    given = read_rows(published, "published")
    keys = given.rows[["quantity", "patch"]].apply(tuple, axis=1)
    unknown = keys[~keys.isin(computed)]
    given.refuse((line, f"the study has no {key}") for line, key in unknown.items())
    rows = given.rows.rename(columns={"value": "published"})
    values = keys.map(computed).astype(float)
    write_table(table, rows.assign(computed=values)[columns_of("published")])


if "snakemake" in globals():
    run_script(snakemake, main)
