"""Register T1 to T0, patch by patch, and take the height change."""

import logging
from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.change.change import Detection, register_patch
from gstlib.change.form import form_doubt
from gstlib.io.store import Stored, read_attributes, write_dataset


def main(
    t0: list[Path],
    t1: list[Path],
    detection: Path | list,
    registered: list[Path],
    *,
    patches: list[str],
    **settings: float,
) -> None:
    names = "height", "filled", "outlier"
    before = Stored(dict(zip(patches, t0, strict=True)), names)
    after = Stored(dict(zip(patches, t1, strict=True)), names)
    measured = Detection.of(read_attributes(detection)) if detection else None
    further = [detection] if detection else []
    for patch, first, second, change in zip(patches, t0, t1, registered, strict=True):
        scans = before[patch], after[patch]
        if doubt := form_doubt(*(scan.height for scan in scans)):
            logging.getLogger("gstlib").warning("patch %s: %s", patch, doubt)
        found = register_patch(*scans, patch=patch, detection=measured, **settings)
        write_dataset(change, found, provenance([first, second, *further], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
