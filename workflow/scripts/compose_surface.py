"""Lay the T0 scans on the mesh's surface, with detail like theirs between them."""

from pathlib import Path

import pandas as pd

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.io.store import read_dataset, write_dataset
from gstlib.study import compose_surface


def main(
    surface: Path, t0: list[Path], composite: Path, *, patches: dict[str, list], **settings
) -> None:
    files = dict(zip(patches["patch"], t0, strict=True))
    heights = (
        (patch, read_dataset(file, only=["height"]).height)
        for patch, file in patch_by_patch(files)
    )
    composed = compose_surface(
        read_dataset(surface), pd.DataFrame(patches), heights, **settings
    )
    write_dataset(composite, composed, provenance([surface, *t0], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
