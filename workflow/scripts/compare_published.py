"""Compare results of the study with published values."""

from pathlib import Path

from gst.config.published import read_published
from gst.config.tables import columns_of, write_table
from gst.run.logs import run_in_snakemake
from gstlib.io.tables import read_pressures, read_table
from gstlib.validation.published import figures_to_compare


def main(published: Path, path: Path, pressures: Path, table: Path) -> None:
    """`published` is a CSV of quantity, patch, unit, value; `path` is the macroscale load path."""
    of_patches = read_pressures(pressures)
    computed = figures_to_compare(read_table(path), of_patches)
    rows = read_published(published, [*of_patches.patch])
    rows = rows.rename(columns={"value": "published"})
    keys = rows[["quantity", "patch"]].apply(tuple, axis=1)
    rows["computed"] = keys.map(computed).astype(float)
    write_table(table, rows[columns_of("published")])


run_in_snakemake(main)
