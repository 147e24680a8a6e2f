"""Read and clean the scans of a batch of patches at one epoch."""

import logging
from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.run.stored import write_result
from gstlib.errors import concerning
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_patch


def main(
    scans: list[Path],
    surfaces: Path,
    *,
    patches: list[str],
    epoch: str,
    crops: list,
    flips: list[str],
    settings: dict,
    preprocessing: dict,
) -> None:
    read = None
    for patch, scan, crop, flip in zip(patches, scans, crops, flips, strict=True):
        if read is None or read[0] != scan:  # several patches may be pieces of one scan
            unit, spacing_um = settings["unit"], settings["spacing_um"]
            with concerning([patch]):
                read = scan, read_scan(scan, unit=unit, spacing_um=spacing_um)
        used = {
            "scans": settings,
            "preprocessing": preprocessing,
            "crop": crop,
            "flip": flip,
        }
        prepared = prepare_patch(read[1], epoch=epoch, **used)
        write_result(surfaces / f"{patch}_{epoch}.h5", prepared, "prepare_scans")
        logging.getLogger("gst").info("%s at %s: %s", patch, epoch, scan)


run_in_snakemake(main)
