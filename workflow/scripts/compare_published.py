"""Compare results of the study with published values."""

from pathlib import Path

from gst.config.tables import columns_of, write_table
from gst.config.user_tables import read_rows
from gst.run.logs import run_in_snakemake
from gstlib.io.tables import read_pressures, read_table
from gstlib.validation.published import figures_to_compare


def main(published: Path, path: Path, pressures: Path, table: Path) -> None:
    """`published` is a CSV of quantity, patch, unit, value; `path` is the macroscale load path."""
    computed = figures_to_compare(read_table(path), read_pressures(pressures))
    table_of_user = read_rows(published, "published")
    rows = table_of_user.rows.rename(columns={"value": "published"})
    keys = rows[["quantity", "patch"]].apply(tuple, axis=1)
    unknown = keys[~keys.isin(computed)]
    table_of_user.refuse(
        (line, f"the study has no {key}") for line, key in unknown.items()
    )
    rows["computed"] = keys.map(computed).astype(float)
    write_table(table, rows[columns_of("published")])


run_in_snakemake(main)
