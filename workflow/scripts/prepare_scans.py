"""Read and clean scans: the surfaces of every patch at one epoch.

Inputs: the scans. Outputs: a surface for each. Settings: the piece to cut out of each scan, patch
side, how scans are stored, preprocessing.
"""

import logging
from pathlib import Path

from gstlib.io.store import write_dataset
from gstlib.logs import job_log
from gstlib.preprocess.patch import clean_scan
from gstlib.provenance import provenance


def main(files: list[Path], surfaces: list[Path], crops: list, **settings) -> None:
    for scan, surface, crop in zip(files, surfaces, crops, strict=True):
        prepared = clean_scan(scan, crop=crop, **settings)
        write_dataset(surface, prepared, provenance([scan], settings | {"crop": crop}))
        logging.getLogger("gstlib").info("%s: %s", surface.stem, scan)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            [Path(file) for file in snakemake.input.scans],
            [Path(file) for file in snakemake.output.surfaces],
            snakemake.params.crops,
            patch_mm=snakemake.params.patch_mm,
            scans=snakemake.params.scans,
            preprocessing=snakemake.params.preprocessing,
        )
