"""Register T1 to T0 for each patch of a batch, and compute the change of height."""

import logging
from pathlib import Path

from gst.run.logs import run_in_snakemake
from gst.run.stored import scans_of, write_result
from gstlib.change.change import SCAN_FIELDS, Detection, register_patch
from gstlib.change.form import form_warning
from gstlib.io.store import read_attributes


def main(
    t0: list[Path],
    t1: list[Path],
    detection: Path | list,
    registered: Path,
    *,
    patches: list[str],
    **settings: float,
) -> None:
    """`settings` are arguments of `register_patch`."""
    first, second = (scans_of(each, patches, SCAN_FIELDS) for each in (t0, t1))
    measured = Detection.from_attrs(read_attributes(detection)) if detection else None
    for patch in patches:
        scans = first[patch], second[patch]
        if doubt := form_warning(*(scan.height for scan in scans)):
            logging.getLogger("gstlib").warning("patch %s: %s", patch, doubt)
        change = register_patch(*scans, patch=patch, detection=measured, **settings)
        write_result(registered / f"{patch}.h5", change, "register_patches")


run_in_snakemake(main)
