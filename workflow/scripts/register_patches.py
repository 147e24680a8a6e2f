"""Register T1 to T0, patch by patch, and take the height change."""

from pathlib import Path

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.io.store import read_dataset, write_dataset
from gstlib.validation.change import register_patch


def main(
    t0: list[Path],
    t1: list[Path],
    registered: list[Path],
    *,
    patches: list[str],
    **settings: float,
) -> None:
    files = dict(zip(patches, zip(t0, t1, registered, strict=True), strict=True))
    for patch, (before, after, change) in patch_by_patch(files):
        epochs = [
            read_dataset(file, only=["height", "filled", "outlier"]) for file in (before, after)
        ]
        found = register_patch(*epochs, patch=patch, **settings)
        write_dataset(change, found, provenance([before, after], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
