"""Press the face in some poses of the active tool, one after the other."""

from pathlib import Path

import pandas as pd

from gst.run.logs import run_script
from gst.run.provenance import provenance
from gst.run.stored import active_tool_of, dataset_of, face_of
from gstlib.io.store import write_dataset
from gstlib.macroscale.gesture import Gesture, press_poses
from gstlib.use.outcome import as_used


def main(
    face: Path,
    second: Path | list,
    use: Path | list,
    batch: Path,
    *,
    size_mm: float,
    through: tuple[float, float],
    poses: dict,
    patches: dict,
    contact_modulus_MPa: float,
    tolerance: float,
    patch_mm: float,
    shown: list[int],
) -> None:
    whole, through = as_used(face_of(face), dataset_of(use), through)
    tool = whole.counterface, active_tool_of(second), size_mm
    gesture = Gesture(*tool, through, pd.DataFrame(poses))
    pressed = {"contact_modulus_MPa": contact_modulus_MPa, "tolerance": tolerance}
    settings = pressed | {"patch_mm": patch_mm, "shown": shown}
    found = press_poses(whole.height, gesture, pd.DataFrame(patches), **settings)
    made = provenance([face, *filter(None, (use, second))], settings)
    write_dataset(batch, found, made)


if "snakemake" in globals():
    run_script(snakemake, main)
