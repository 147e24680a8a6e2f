"""Measure the error of a height change on patches that were scanned twice without use between."""

from pathlib import Path

import xarray as xr

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.change.change import measure_detection
from gstlib.io.store import Stored, write_dataset


def main(
    t0: list[Path],
    repeats: list[Path],
    detection: Path,
    *,
    patches: list[str],
    **settings: float,
) -> None:
    names = "height", "filled", "outlier"
    before = Stored(dict(zip(patches, t0, strict=True)), names)
    again = Stored(dict(zip(patches, repeats, strict=True)), names)
    found = measure_detection(before, again, **settings)
    attrs = found._asdict() if found else {}  # nothing where no repeat serves
    write_dataset(detection, xr.Dataset(attrs=attrs), provenance([*t0, *repeats], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
