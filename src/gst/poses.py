"""The poses of the active stone that a config asks for, and how far they reach."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from gstlib.gesture import read_poses, stroke_poses

__all__ = ["poses_of", "reach_of"]


def poses_of(config: Mapping[str, Any]) -> pd.DataFrame | None:
    """The poses that a config asks for, from its table or of its stroke; None without gesture."""
    if (gesture := config["gesture"]) is None:
        return None
    if "table" in gesture:
        return read_poses(gesture["table"], size_mm=config["square"]["size_mm"])
    pressure = config["macroscale"]["target_pressure_MPa"]
    return stroke_poses(**gesture, pressure_MPa=pressure)


def reach_of(config: Mapping[str, Any]) -> float:
    """How far around the square (mm) the active stone's face is needed.

    That is for the poses of the gesture, if there is one, and for errors of the pose of five
    standard deviations.
    """
    reach = 5e-3 * config["uncertainty"]["pose_um"]
    if (poses := poses_of(config)) is None:
        return reach
    turn = np.radians(poses.rotation_deg.abs().clip(upper=45))
    corners = config["square"]["size_mm"] / 2 * (np.cos(turn) + np.sin(turn) - 1)
    # turned back, a shift has at most its length along either axis
    return max(reach, float((np.hypot(poses.x_mm, poses.y_mm) + corners).max()))
