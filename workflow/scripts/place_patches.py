"""Hold each patch against the macroscale surface under it, and warn of wrong places."""

from pathlib import Path

import pandas as pd

from gst.batches import files_of
from gst.logs import run_script
from gst.tables import write_table
from gstlib.coupling.placement import place_patches
from gstlib.io.store import Stored, read_dataset


def main(
    face: Path,
    t0: list[Path],
    table: Path,
    *,
    patches: dict[str, list],
    patch_mm: float,
    invert: bool,
    flip: str | None,
    accept: list[str],
) -> None:
    scans = Stored(files_of(t0, patches["patch"]), ["height"])
    given = read_dataset(face, only=["height"]).height, pd.DataFrame(patches), scans
    settings = {"patch_mm": patch_mm, "invert": invert, "flip": flip, "accept": accept}
    write_table(table, place_patches(*given, **settings))


if "snakemake" in globals():
    run_script(snakemake, main)
