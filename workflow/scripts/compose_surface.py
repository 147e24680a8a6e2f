"""Lay the T0 scans on the mesh's surface, with detail like theirs between them."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.macroscale.composite import compose_surface


def main(
    face: Path, t0: list[Path], composite: Path, *, patches: dict[str, list], **settings
) -> None:
    scans = Stored(dict(zip(patches["patch"], t0, strict=True)), ["height"])
    composed = compose_surface(read_dataset(face), pd.DataFrame(patches), scans, **settings)
    write_dataset(composite, composed, provenance([face, *t0], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
