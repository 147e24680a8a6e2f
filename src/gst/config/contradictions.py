"""Files and tables that cannot go together with a config, and values that are improbable.

The config is whole, and its values can be used (`gstlib.settings`). Each problem is a sentence with
its key, its value and the remedy.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from gst.config.patches import at_epoch, overlaps, scan_files
from gstlib.conditions import load_force
from gstlib.errors import ConfigError, FaultError
from gstlib.settings.contradictions import near

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
    if config["specimen"] is not None:
        spacing_um = config["specimen"]["scan_spacing_um"]
        yield from thinner_than_a_point(config["interlayer"], spacing_um)
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
    if inside := _input_in_results(config):
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
    interlayer: Mapping | None, spacing_um: float
) -> Iterator[FaultError]:
    """Whether an interlayer is thinner than two points of a scan are apart."""
    if interlayer and (thickness := interlayer["thickness_um"]) < spacing_um:
        yield FaultError(
            "interlayer",
            "interlayer.thickness_um",
            f"{thickness:g} µm is less than the {spacing_um:.3g} µm between two points of a scan, "
            "so that the interlayer has no measurable effect",
            "Make it thicker, or set interlayer to null.",
        )


def files_read(config: Mapping, patches: pd.DataFrame) -> list[str]:
    """Every file of the user that a study reads: tables, meshes and scans.

    `config` is whole; `patches` is its patch table.
    """
    return sorted({str(Path(file)) for file in _files(config, patches).values()})


def check_files(config: Mapping, patches: pd.DataFrame, source: str) -> None:
    """Raise a `ConfigError` that lists files that are missing, or of unusable names.

    `config` is whole, and called `source`; `patches` is its patch table.
    """
    files = _files(config, patches)
    problems = [
        f"\n  - {kind}: {problem}"
        for kind, path in files.items()
        if (problem := path_problem(path))
    ]
    if problems:
        problem = f"{len(problems)} of {len(files)} files cannot be used{''.join(problems)}\n "
        remedy = "Put them there, or correct their names. Paths are relative to the working folder."
        names = filter(None, [source, config["patches"]])
        raise ConfigError(", ".join(names), problem, remedy)


def _files(config: Mapping, patches: pd.DataFrame) -> dict[str, str]:
    """The files of the user, by their kind."""
    files = _named_files(config)
    if config["inputs"] is not None:
        for scan in scan_files(patches, config["inputs"]["scan_folder"] or "", None):
            files[at_epoch(scan.patch, scan.epoch)] = str(scan.path)
    return files


def _named_files(config: Mapping) -> dict[str, str]:
    """The files that the config itself names, by their kind."""
    inputs, gesture, tool = (
        config[name] or {} for name in ("inputs", "gesture", "counterface")
    )
    files = {
        "patch table": config["patches"],
        "published figures": config["published"],
        "poses": gesture.get("table"),
        "mesh": inputs.get("mesh"),
        "counterface's mesh": tool.get("mesh"),
        "counterface's scan": tool.get("scan"),
    }
    return {kind: file for kind, file in files.items() if file is not None}


def path_problem(path: str) -> str | None:
    """The problem with the path of a file, if there is one."""
    if set("{}") & set(path):
        return f"{path} contains braces, which Snakemake reads as a placeholder"
    if "\0" in path:
        return f"{path!r} contains a NUL, which no name of a file can have"
    file = Path(path)
    if file.is_file():
        return None
    if file.is_dir():
        return f"{path} is a folder, and not a file"
    if file.exists():
        return f"{path} is a pipe or a device, and not a file"
    there = []
    if file.parent.is_dir():
        there = [other.name for other in file.parent.iterdir()]
    hint = near(file.name, there).strip()
    return f"{path} does not exist" + f" ({hint})" * bool(hint)


def _input_in_results(config: Mapping) -> str | None:
    """An input of the study, or the working folder, that lies in the folder of the results."""
    scans = (config["inputs"] or {}).get("scan_folder")
    files = {"working folder": ".", **_named_files(config), "scans": scans}
    folder = os.path.realpath(config["results"])
    for kind, file in files.items():
        if file is not None and Path(os.path.realpath(file)).is_relative_to(folder):
            return f"the {kind} ({file})"
    return None
