"""Solve the contact of the face in some poses of the active tool, one after the other."""

from pathlib import Path
from typing import Any

import pandas as pd

from gst.run.logs import run_in_snakemake
from gst.run.stored import active_tool_of, dataset_of, face_of, write_result
from gstlib.macroscale.gesture import Gesture, press_poses
from gstlib.use.outcome import as_used


def main(
    face: Path,
    second: Path | list,
    use: Path | list,
    batch: Path,
    *,
    size_mm: float,
    load_point: tuple[float, float],
    poses: dict,
    patches: dict,
    **settings: Any,
) -> None:
    """`settings` are arguments of `press_poses`."""
    whole, load_point = as_used(face_of(face), dataset_of(use), load_point)
    tool = whole.counterface, active_tool_of(second), size_mm
    gesture = Gesture(*tool, load_point, pd.DataFrame(poses))
    pressed = press_poses(whole.height, gesture, pd.DataFrame(patches), **settings)
    write_result(batch, pressed, "press_poses")


run_in_snakemake(main)
