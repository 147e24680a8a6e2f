"""Measure the texture of every patch before and after use."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import changes_of, scans_of
from gstlib.change.texture import measure_texture


def main(
    t0: list[Path],
    registered: list[Path],
    table: Path,
    *,
    patches: list[str],
    worn: list[str],
    texture: dict,
) -> None:
    scans = scans_of(t0, patches)
    changes = changes_of(registered, worn, ["t1"])
    write_table(table, measure_texture(scans, changes, **texture))


run_in_snakemake(main)
