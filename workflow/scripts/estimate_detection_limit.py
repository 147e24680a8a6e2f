"""Estimate the error of a height change from patches that were scanned twice without use."""

from pathlib import Path

import xarray as xr

from gst.run.logs import run_in_snakemake
from gst.run.stored import scans_of, write_result
from gstlib.change.change import SCAN_FIELDS, estimate_detection_limit


def main(
    t0: list[Path],
    repeats: list[Path],
    detection: Path,
    *,
    patches: list[str],
    **settings: float,
) -> None:
    """`settings` are arguments of `estimate_detection_limit`."""
    first, second = (scans_of(each, patches, SCAN_FIELDS) for each in (t0, repeats))
    measured = estimate_detection_limit(first, second, **settings)
    attrs = measured._asdict() if measured else {}  # nothing where no repeat serves
    write_result(detection, xr.Dataset(attrs=attrs), "estimate_detection_limit")


run_in_snakemake(main)
