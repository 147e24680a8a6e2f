"""The poses of the active tool that a config asks for, and how far they reach."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gst.config.user_tables import read_rows
from gstlib.conditions import load_force
from gstlib.errors import ConfigError
from gstlib.macroscale.gesture import scatter_poses, stroke_poses
from gstlib.surfaces.footprints import half_extent

# A job takes as long to start as a hundred poses to press.
_IN_BATCH = 200


def poses_of(config: Mapping[str, Any]) -> pd.DataFrame | None:
    """The poses that a config asks for; None without gesture."""
    gesture, size_mm = config["gesture"], config["square"]["size_mm"]
    if gesture is None:
        return None
    if "table" in gesture:
        return read_poses(gesture["table"], size_mm=size_mm)
    force_N = load_force(config["load"], size_mm)
    if "load_point_scatter_mm" in gesture:
        return scatter_poses(**gesture, force_N=force_N, seed=config["seed"])
    return stroke_poses(**gesture, force_N=force_N)


def read_poses(path: str | Path, *, size_mm: float) -> pd.DataFrame:
    """The poses of a table, with the columns of `gstlib.macroscale.gesture.stroke_poses`.

    `workflow/schemas/poses.schema.yaml` describes a row, which has a force, or a pressure on the
    square of side `size_mm`. A `ConfigError` lists all that is wrong, with line numbers.
    """
    table = read_rows(path, "poses")
    rows = table.rows
    unclear = rows.index[rows.force_N.isna() == rows.pressure_MPa.isna()]
    table.refuse((line, "give one of force_N and pressure_MPa") for line in unclear)
    if not rows.weight.any():
        raise ConfigError(path, "no pose has a weight", "Give weights above 0.")
    pressure_MPa = rows.pop("pressure_MPa")
    return rows.fillna({"force_N": pressure_MPa * size_mm**2}).reset_index(drop=True)


def batches_of(poses: pd.DataFrame | None) -> dict[str, dict]:
    """By name, as many poses in order as one job presses, as params; none without poses.

    Each column has its values by the number of the pose.
    """
    if poses is None:
        return {}
    starts = range(0, len(poses), _IN_BATCH)
    batches = (poses[start : start + _IN_BATCH] for start in starts)
    return {str(n): batch.to_dict() for n, batch in enumerate(batches, start=1)}


def reach_of(config: Mapping[str, Any], poses: pd.DataFrame | None) -> float:
    """How far around the passive face (mm) the active tool's own is needed.

    That is for the `poses` of `poses_of`, if there are any, and for errors of the pose of five
    standard deviations.
    """
    reach = 5e-3 * config["uncertainty"]["pose_um"]
    if poses is None:
        return reach
    face_mm, turn = config["macroscale"]["face_mm"], poses.rotation_deg.abs()
    corners = half_extent(face_mm, turn.clip(upper=45)) - face_mm / 2
    # turned back, a shift has at most its length along either axis
    shift = np.hypot(poses.x_mm, poses.y_mm)
    return max(reach, float((shift + corners).max()))
