"""Read and clean scans: the surfaces of every patch at one epoch.

Inputs: the scans. Outputs: a surface for each. Settings: the piece to cut out of each scan, patch
side, how scans are stored, preprocessing.
"""

import logging
from functools import lru_cache
from pathlib import Path

import xarray as xr

from gstlib.io.scans import check_size, cut_scan, read_scan, read_settings
from gstlib.io.store import write_dataset
from gstlib.logs import job_log
from gstlib.preprocess.mould import unmould
from gstlib.preprocess.scan import prepare_scan
from gstlib.provenance import provenance

# several patches may be pieces of one scan
read_once = lru_cache(maxsize=1)(read_scan)


def prepare(
    scan: Path,
    surface: Path,
    *,
    patch_mm: float,
    crop: list | None,
    scans: dict,
    preprocessing: dict,
) -> None:
    """Read, cut, clean and store one scan."""
    raw: xr.DataArray = read_once(scan, **read_settings(scans))
    if crop is None:
        check_size(raw, patch_mm)
    else:
        raw = cut_scan(raw, crop, patch_mm)
    mould = scans["mould"]
    prepared = prepare_scan(
        raw, mould_invert=mould["invert"], mould_flip=mould["flip"], **preprocessing
    )
    prepared["measured"] = unmould(raw, invert=mould["invert"], flip_axis=mould["flip"])
    settings = {"patch_mm": patch_mm, "crop": crop, "scans": scans, "preprocessing": preprocessing}
    write_dataset(surface, prepared, provenance([scan], settings))
    logging.getLogger("gstlib").info("%s: %s", surface.stem, scan)


def main(files: list[Path], surfaces: list[Path], crops: list, **settings) -> None:
    for scan, surface, crop in zip(files, surfaces, crops, strict=True):
        prepare(scan, surface, crop=crop, **settings)


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
