"""Read and clean the scans of several patches at one epoch."""

import logging
from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.io.scans import read_scan
from gstlib.io.store import write_dataset
from gstlib.preprocess.scans import prepare_patch


def main(
    scans: list[Path],
    surfaces: list[Path],
    *,
    crops: list,
    flips: list[str],
    settings: dict,
    preprocessing: dict,
    epoch: str,
) -> None:
    read = None
    for scan, surface, crop, flip in zip(scans, surfaces, crops, flips, strict=True):
        if read is None or read[0] != scan:  # several patches may be pieces of one scan
            read = (
                scan,
                read_scan(scan, unit=settings["unit"], spacing_um=settings["spacing_um"]),
            )
        used = {"scans": settings, "preprocessing": preprocessing, "crop": crop, "flip": flip}
        prepared = prepare_patch(read[1], epoch=epoch, **used)
        write_dataset(surface, prepared, provenance([scan], used))
        logging.getLogger("gst").info("%s: %s", surface.stem, scan)


if "snakemake" in globals():
    run_script(snakemake, main)
