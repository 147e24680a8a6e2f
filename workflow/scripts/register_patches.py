"""Register T1 to T0, patch by patch, and take the height change."""

from pathlib import Path

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.io.store import Stored, write_dataset
from gstlib.validation.change import register_patch


def main(
    t0: list[Path],
    t1: list[Path],
    registered: list[Path],
    *,
    patches: list[str],
    **settings: float,
) -> None:
    names = "height", "filled", "outlier"
    before = Stored(dict(zip(patches, t0, strict=True)), names)
    after = Stored(dict(zip(patches, t1, strict=True)), names)
    for patch, first, second, change in zip(patches, t0, t1, registered, strict=True):
        found = register_patch(before[patch], after[patch], patch=patch, **settings)
        write_dataset(change, found, provenance([first, second], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
