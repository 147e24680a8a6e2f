"""Press the square in some poses of the active stone, one after the other."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.gesture import Gesture, press_poses
from gstlib.io.store import read_dataset, write_dataset


def main(
    square: Path, face: Path, batch: Path, *, poses: dict, patches: dict, **settings
) -> None:
    height = read_dataset(square, only=["height"]).height
    gesture = Gesture(read_dataset(face).face, pd.DataFrame(poses))
    found = press_poses(height, gesture, pd.DataFrame(patches), **settings)
    write_dataset(batch, found, provenance([square, face], settings))


if "snakemake" in globals():
    run_script(snakemake, main)
