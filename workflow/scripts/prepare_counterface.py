"""Read and clean the scan of the counterface."""

from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.run.stored import write_result
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_patch


def main(scan: Path, surface: Path, *, settings: dict, preprocessing: dict) -> None:
    read = read_scan(scan, unit=settings["unit"], spacing_um=settings["spacing_um"])
    used = {"scans": settings, "preprocessing": preprocessing, "crop": None, "flip": ""}
    prepared = prepare_patch(read, epoch="T0", **used)
    write_result(surface, prepared, "prepare_counterface")


run_in_snakemake(main)
