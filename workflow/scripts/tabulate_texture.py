"""Measure the texture of every patch before and after use."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.batches import files_of
from gst.run.logs import run_in_snakemake
from gstlib.change.texture import measure_texture
from gstlib.io.store import Stored


def main(
    t0: list[Path],
    registered: list[Path],
    table: Path,
    *,
    patches: list[str],
    worn: list[str],
    texture: dict,
) -> None:
    scans = Stored(files_of(t0, patches), ["height"])
    changes = Stored(files_of(registered, worn), ["t1"])
    write_table(table, measure_texture(scans, changes, **texture))


run_in_snakemake(main)
