"""What no schema can express: numbers and files of a config that cannot go together.

The config is whole and fits the schema, which says what else cannot go together. Each problem is a
sentence with its key, its value and the remedy.
"""

import difflib
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from gst.config.named_files import input_in_results, path_problem
from gst.config.patches import overlaps
from gstlib.conditions import load_force, load_point, study_radius
from gstlib.errors import FAULTS, ConfigError, FaultError
from gstlib.surfaces.frames import frame_from_points

__all__ = ["accepted_patches", "contradictions", "counterface_mesh", "improbable"]
__all__ += ["thinner_than_a_point"]

# Corners are clicked or typed: the square's sides may be off by this share.
_SIDE_TOLERANCE = 0.1
# ASSUME: no stone bears a mean pressure (MPa) like this; quartzite is crushed at 150 to 300 MPa.
_CRUSHING_MPA = 1000.0
# Two patches that have more in common (share of a patch) are one, or one has a wrong position.
_ONE_PATCH = 0.5


def contradictions(config: Mapping) -> Iterator[str]:
    """Every such problem of a config."""
    yield from _in_accept(config)
    yield from _in_files(config)
    yield from _in_squares(config)
    yield from _in_load(config)
    yield from _in_interlayer(config)
    yield from _in_use(config)
    short, long = config["texture"]["s_filter_um"], config["texture"]["l_filter_um"]
    if long is not None and long <= short:
        yield (
            f"'texture.l_filter_um' is {long}, not above texture.s_filter_um, {short}: no wave "
            "passes both filters; raise it, or set it to null"
        )


def improbable(config: Mapping, patches: pd.DataFrame) -> Iterator[FaultError]:
    """What is so improbable in a config and its patch table that a user has to accept it."""
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
                f"{share:.0%} of the area of patch {other} is that of patch {one}",
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


def _in_accept(config: Mapping) -> Iterator[str]:
    for entry in config["accept"]:
        name, colon, _ = entry.partition(":")
        if name not in FAULTS:
            yield (
                f"'accept' has {entry!r}, and no fault has that name: "
                f"{_near(name, FAULTS)}write one of {', '.join(FAULTS)}"
            )
        elif colon and config["patches"] is None:
            yield f"'accept' has {entry!r}, and the study has no patches: write {name} alone"


def accepted_patches(config: Mapping, patches: Collection[str]) -> Iterator[str]:
    """Each entry of ``accept`` for a patch that is not among the `patches` of the table."""
    for entry in config["accept"]:
        name, colon, patch = entry.partition(":")
        if colon and patch not in patches:
            yield (
                f"'accept' has {entry!r}, and no patch of {config['patches']} has that name: "
                f"{_near(patch, patches)}write {name} for all patches"
            )


def _near(name: str, possible: Collection[str]) -> str:
    """Which of the `possible` names was probably meant, as the start of a remedy; "" if none."""
    meant = difflib.get_close_matches(name, possible, n=1)
    return f"did you mean {meant[0]}? " if meant else ""


def _in_files(config: Mapping) -> Iterator[str]:
    if inside := input_in_results(config):
        yield (
            f"'results' is {config['results']!r}, a folder that contains {inside}: name a folder "
            "for the results alone"
        )
    for name in ("patches", "published"):
        if config[name] is not None and (problem := path_problem(config[name])):
            yield f"'{name}': {problem}: correct the path"


def _in_use(config: Mapping) -> Iterator[str]:
    """What cannot be inferred from the wear, or goes beyond the face."""
    use, errors = config["use"], config["uncertainty"]
    if use is None or config["coupling"] != "placed":
        return
    face_mm = config["macroscale"]["face_mm"] or config["square"]["size_mm"]
    for key, reach_mm in (
        ("scatter_mm", 2 * use["scatter_mm"]),
        ("stroke_mm", use["stroke_mm"]),
    ):
        if reach_mm > face_mm:
            yield (
                f"'use.{key}' is {use[key]:g}, and such strikes reach over {reach_mm:g} mm of a "
                f"face of {face_mm:g} mm: lower it, or raise macroscale.face_mm"
            )
    gesture = config["gesture"] or {}
    for key, other in (("scatter_mm", "load_point_scatter_mm"), ("stroke_mm", "stroke_mm")):
        if gesture.get(other, 0) > 0 and use[key] == 0:
            yield (
                f"'use.{key}' is 0, and gesture.{other} is {gesture[other]:g}: the inference would "
                "exclude how the gesture moves; raise the former, or set the latter to 0"
            )
    is_round = study_radius(config) is not None
    free = errors["load_point_mm"], use["scatter_mm"], use["stroke_mm"]
    if not any(free) and not (is_round and errors["radius_fraction"]):
        yield (
            "'uncertainty.load_point_mm', 'uncertainty.radius_fraction', 'use.scatter_mm' and "
            "'use.stroke_mm' leave nothing to infer: raise one of them, or set use to null"
        )


def _in_squares(config: Mapping) -> Iterator[str]:
    size_mm, pose = config["square"]["size_mm"], (config["counterface"] or {}).get("pose", {})
    yield from _corner_problems("square.points_mm", config["square"]["points_mm"])
    if "points_mm" in pose:
        yield from _corner_problems("counterface.pose.points_mm", pose["points_mm"])
    if config["scans"]["size_mm"] > size_mm:
        yield (
            f"'scans.size_mm' is {config['scans']['size_mm']}, more than the square's "
            f"{size_mm} mm: a patch must fit in the square"
        )


def _corner_problems(key: str, points: Sequence) -> Iterator[str]:
    """What is wrong with three corners, whatever the size of their square."""
    try:
        frame_from_points(points)
    except ConfigError as error:
        yield f"'{key}': {error.problem}: {error.remedy}"


def _in_load(config: Mapping) -> Iterator[str]:
    """What is wrong with the load, and with what bears it."""
    load, size_mm = config["load"], config["square"]["size_mm"]
    pressure, cap = load_force(load, size_mm) / size_mm**2, config["pressure_cap_MPa"]
    if cap is not None and cap <= pressure:
        yield (
            f"'pressure_cap_MPa' is {cap} MPa, not above the mean pressure on the square, "
            f"{pressure:.4g} MPa: no contact bears more than that; raise it, or set it to null"
        )
    if config["coupling"] == "levelled":
        return
    face_mm = config["macroscale"]["face_mm"]
    if face_mm < size_mm:
        yield (
            f"'macroscale.face_mm' is {face_mm:g}, less than the square's {size_mm:g} mm: the face "
            "contains the square; make it larger"
        )
    low, high = (size_mm - face_mm) / 2, (size_mm + face_mm) / 2
    if not all(low < along < high for along in load_point(load, size_mm)):
        yield (
            f"'load.at_mm' is {load['at_mm']}, outside the face, which reaches from {low:g} to "
            f"{high:g} mm: the stone would tip over; move it inside"
        )


def _in_interlayer(config: Mapping) -> Iterator[str]:
    if (layer := config["interlayer"]) is None:
        return
    stones_MPa = min(config["material"][f"young_{stone}_MPa"] for stone in (1, 2))
    if layer["young_MPa"] >= stones_MPa:
        yield (
            f"'interlayer.young_MPa' is {layer['young_MPa']:g}, not below the stones' "
            f"{stones_MPa:g} MPa: an interlayer must be softer than the stones; lower it, or set "
            "interlayer to null"
        )


def counterface_mesh(config: Mapping, specimen: str) -> dict | None:
    """The active tool: its ``mesh``, ``mesh_unit`` and ``pose``; None if it is flat.

    `specimen` is the folder of a synthetic active tool, whose square is laid on the passive one's.
    """
    if (config["specimen"] or {}).get("counterface_seed") is not None:
        pose = {"points_mm": config["square"]["points_mm"]}
        return {"mesh": f"{specimen}/counterface.stl", "mesh_unit": "mm", "pose": pose}
    given = config["counterface"] or {}
    if "mesh" not in given:
        return None
    # no default of the schema, which a stone without a mesh would get, too
    return {"mesh_unit": "mm"} | {name: of for name, of in given.items() if name != "scan"}


def thinner_than_a_point(interlayer: Mapping, spacing_um: float) -> Iterator[FaultError]:
    """Whether an interlayer is thinner than two points of a scan are apart."""
    if (thickness := interlayer["thickness_um"]) < spacing_um:
        yield FaultError(
            "interlayer",
            "interlayer.thickness_um",
            f"{thickness:g} µm is less than the {spacing_um:.3g} µm between two points of a scan, "
            "so that the interlayer has no measurable effect",
            "Make it thicker, or set interlayer to null.",
        )
