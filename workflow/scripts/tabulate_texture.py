"""Measure the texture of every patch before and after use."""

from pathlib import Path

from gst.logs import patch_by_patch, run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.study import measure_texture


def main(
    t0: list[Path],
    registered: list[Path],
    table: Path,
    *,
    patches: list[str],
    worn: list[str],
    texture: dict,
) -> None:
    changes = dict(zip(worn, registered, strict=True))
    patches_of = (
        (
            patch,
            read_dataset(file, only=["height"]).height,
            read_dataset(changes[patch], only=["t1"]) if patch in changes else None,
        )
        for patch, file in patch_by_patch(dict(zip(patches, t0, strict=True)))
    )
    write_table(table, measure_texture(patches_of, **texture))


if "snakemake" in globals():
    run_script(snakemake, main)
