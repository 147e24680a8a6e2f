"""Files and tables that cannot go together with a config, and values that are improbable.

The config is whole, and its values can be used (`gstlib.settings`). Each problem is a sentence with
its key, its value and the remedy.
"""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from gst.config.named_files import input_in_results, path_problem
from gst.config.patches import overlaps
from gstlib.conditions import load_force
from gstlib.errors import FaultError

# Corners are clicked or typed: the square's sides may be off by this share.
_SIDE_TOLERANCE = 0.1
# ASSUME: Largest mean pressure. A stone does not carry a mean pressure above 1000 MPa. Reason:
# Quartzite is crushed at 150 to 300 MPa.
_CRUSHING_MPA = 1000.0
# Two patches that have more in common (share of a patch) are one, or one has a wrong position.
_ONE_PATCH = 0.5


def improbable(config: Mapping, patches: pd.DataFrame) -> Iterator[FaultError]:
    """Improbable values of a config and its patch table that a user has to accept."""
    size_mm = config["square"]["size_mm"]
    yield from _improbable_squares(config, size_mm)
    load = config["load"]
    if (pressure := load_force(load, size_mm) / size_mm**2) > _CRUSHING_MPA:
        yield FaultError(
            "pressure",
            "load",
            f"it presses the square of {size_mm:g} mm with {pressure:.4g} MPa on average, and no "
            "stone bears that (quartzite is crushed at 150 to 300 MPa)",
            "Give the force of use in N, which for a hand is some tens to some hundreds.",
        )
    if config["interlayer"] is not None and config["specimen"] is not None:
        yield from thinner_than_a_point(
            config["interlayer"], config["specimen"]["scan_spacing_um"]
        )
    for one, other, share in overlaps(patches, config["scans"]["size_mm"]):
        if share > _ONE_PATCH:
            yield FaultError(
                "overlap",
                config["patches"],
                f"{share:.0%} of the area of patch {other} belongs to patch {one}, too",
                "Leave one of them out, or correct their positions.",
                [other],
            )


def _improbable_squares(config: Mapping, size_mm: float) -> Iterator[FaultError]:
    """Squares whose corners are not as far apart as their size."""
    pose = (config["counterface"] or {}).get("pose", {})
    squares = {"square.points_mm": config["square"]["points_mm"]}
    if "points_mm" in pose:
        squares["counterface.pose.points_mm"] = pose["points_mm"]
    for key, points in squares.items():
        sides = np.linalg.norm(np.subtract(points[1:], points[0]), axis=1)
        if (abs(sides - size_mm) > _SIDE_TOLERANCE * size_mm).any():
            yield FaultError(
                "square",
                key,
                f"the corners are {sides[0]:.3g} and {sides[1]:.3g} mm apart, and "
                f"square.size_mm is {size_mm:g}",
                "Give the corners of the square in mm, or correct its size.",
            )


def file_problems(config: Mapping) -> Iterator[str]:
    """Whether results lie around an input, and a table is not there."""
    if inside := input_in_results(config):
        yield (
            f"'results' is {config['results']!r}, a folder that contains {inside}: name a folder "
            "for the results alone"
        )
    for name in ("patches", "published"):
        if config[name] is not None and (problem := path_problem(config[name])):
            yield f"'{name}': {problem}: correct the path"


def counterface_mesh(config: Mapping, specimen: str) -> dict | None:
    """The active tool: its ``mesh``, ``mesh_unit`` and ``pose``; None if it is flat.

    `specimen` is the folder of a synthetic active tool, whose square is laid on the passive one's.
    """
    if (config["specimen"] or {}).get("counterface_seed") is not None:
        pose = {"points_mm": config["square"]["points_mm"]}
        return {"mesh": f"{specimen}/counterface.stl", "mesh_unit": "mm", "pose": pose}
    tool = config["counterface"] or {}
    if "mesh" not in tool:
        return None
    # no default of the schema, which a stone without a mesh would get, too
    return {"mesh_unit": "mm"} | {
        name: value for name, value in tool.items() if name != "scan"
    }


def thinner_than_a_point(
    interlayer: Mapping, spacing_um: float
) -> Iterator[FaultError]:
    """Whether an interlayer is thinner than two points of a scan are apart."""
    if (thickness := interlayer["thickness_um"]) < spacing_um:
        yield FaultError(
            "interlayer",
            "interlayer.thickness_um",
            f"{thickness:g} µm is less than the {spacing_um:.3g} µm between two points of a scan, "
            "so that the interlayer has no measurable effect",
            "Make it thicker, or set interlayer to null.",
        )
