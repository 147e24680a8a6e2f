"""Press the square in some poses of the active stone, one after the other."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.gesture import press_poses
from gstlib.io.store import read_dataset, write_dataset


def main(square: Path, batch: Path, *, poses: dict, patches: dict, **settings: float) -> None:
    surface = read_dataset(square, only=["height", "face"])
    found = press_poses(
        surface, pd.DataFrame(poses), pd.DataFrame(patches), source=square, **settings
    )
    write_dataset(batch, found, provenance([square], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
