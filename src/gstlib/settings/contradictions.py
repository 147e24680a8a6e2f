"""Contradictions in settings. Each message names key, value and remedy."""

import difflib
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

from gstlib.bem.layer import LONGEST_ELEMENT
from gstlib.conditions import load_force, resolved_load_point
from gstlib.errors import FAULTS, ConfigError
from gstlib.surfaces.frames import frame_from_points

if TYPE_CHECKING:
    from gstlib.settings.sections import Section, Settings

__all__ = ["contradictions", "near"]

_A_GESTURE = "give a table, or poses with stroke_mm or load_point_scatter_mm"
# Keys of a section, each with the other key that it needs.
_NEEDED = {
    "counterface": {
        "mesh": "pose",
        "pose": "mesh",
        "mesh_unit": "mesh",
        "angle_deg": "radius_mm",
    },
    "gesture": {"stroke_mm": "poses", "load_point_scatter_mm": "poses"},
}


def contradictions(settings: "Settings") -> Iterator[str]:
    """All contradictions in settings whose keys have valid types and bounds."""
    checks = (
        _sources,
        _counterface,
        _gesture,
        _without_patches,
        _missing_keys,
        _in_lists,
        _in_squares,
        _in_load,
        _in_use,
    )
    for check in checks:
        yield from check(settings)


def near(name: str, possible: Collection[str]) -> str:
    """The closest of the `possible` names, as the start of a remedy; "" if none is close."""
    meant = difflib.get_close_matches(name, possible, n=1)
    return f"did you mean {meant[0]}? " if meant else ""


def _sources(settings: "Settings") -> Iterator[str]:
    if (settings.specimen is None) == (settings.inputs is None):
        yield (
            "give exactly one of 'specimen' (generated) and 'inputs' (your files), and set the "
            "other to null"
        )
    short, long = settings.texture.s_filter_um, settings.texture.l_filter_um
    if long is not None and long <= short:
        yield (
            f"'texture.l_filter_um' is {long}, not above texture.s_filter_um, {short}, so no wave "
            "passes both filters: raise it, or set it to null"
        )
    material, layer = settings.material, settings.interlayer
    if layer is None:
        return
    stones_MPa = min(material.young_1_MPa, material.young_2_MPa)
    if layer.young_MPa >= stones_MPa:
        yield (
            f"'interlayer.young_MPa' is {layer.young_MPa:g}, not below the stones' "
            f"{stones_MPa:g} MPa, but an interlayer must be softer than the stones: lower it, or "
            "set interlayer to null"
        )
    element_um = 1e3 * settings.square.size_mm / settings.macroscale.grid
    thinnest_um = element_um / LONGEST_ELEMENT
    if layer.thickness_um < thinnest_um:
        yield (
            f"'interlayer.thickness_um' is {layer.thickness_um:g}, below {thinnest_um:.3g}, a "
            f"{LONGEST_ELEMENT}th of the macroscale's elements: make it thicker, raise "
            "macroscale.grid, or set interlayer to null"
        )


def _counterface(settings: "Settings") -> Iterator[str]:
    tool = settings.counterface
    is_paper = settings.coupling == "paper"
    is_generated = settings.specimen and settings.specimen.counterface_seed is not None
    has_mesh = tool is not None and tool.mesh is not None
    has_radius = tool is not None and tool.radius_mm is not None
    if is_paper and (has_mesh or is_generated):
        yield (
            "'counterface.mesh' (or specimen.counterface_seed) does not go with coupling paper, "
            "which presses a flat: set coupling to equilibrium"
        )
    is_inferred = settings.use is not None and not is_paper
    is_given = settings.uncertainty.radius_log_sd < 0.7
    if is_inferred and is_given and not (has_radius or has_mesh):
        yield (
            "'uncertainty.radius_log_sd' is the error of a radius, but 'counterface' is a flat "
            "without one: give counterface.radius_mm, or leave radius_log_sd out"
        )
    if has_mesh and has_radius:
        yield "'counterface' has a radius and a mesh: give one of them"
    if tool and tool.pose and len(tool.pose.model_fields_set) != 1:
        yield "'counterface.pose' needs either points_mm or matrix: give exactly one of them"


def _gesture(settings: "Settings") -> Iterator[str]:
    law, gesture = settings.wear_law, settings.gesture
    has_layer = settings.interlayer is not None
    if gesture and settings.coupling == "paper":
        yield (
            "'gesture' does not go with coupling paper: set coupling to equilibrium, or gesture "
            "to null"
        )
    if gesture and has_layer:
        yield "'gesture' and 'interlayer' cannot be combined: set one of them to null"
    if (gesture or has_layer) and (law.threshold_MPa, law.exponent) != (0, 1):
        yield (
            "'wear_law' is not Archard's, which gesture and interlayer need: set both of them to "
            "null, or leave wear_law out"
        )
    keys = gesture.model_fields_set if gesture else set()
    if "table" in keys and len(keys) > 1:
        yield f"'gesture' has a table and other keys: {_A_GESTURE}"
    if keys == {"poses"}:
        yield f"'gesture' has poses alone: {_A_GESTURE}"
    if {"stroke_mm", "load_point_scatter_mm"} <= keys:
        yield "'gesture' has stroke_mm and load_point_scatter_mm: give one of them"


def _without_patches(settings: "Settings") -> Iterator[str]:
    if settings.patches is not None:
        return
    if settings.gesture is None:
        yield (
            "'patches' and 'gesture' are null: proposed positions depend on the scatter of the "
            "load point. Set gesture, such as {load_point_scatter_mm: 1, poses: 60}, or give a "
            "patch table"
        )
    tool = settings.counterface
    needing = {
        "published": settings.published,
        "interlayer": settings.interlayer,
        "counterface.scan": tool and tool.scan,
    }
    for name, value in needing.items():
        if value is not None:
            yield (
                f"'patches' is null, and {name} needs scanned patches: set it to null or remove "
                "it, or give a patch table"
            )


def _missing_keys(settings: "Settings") -> Iterator[str]:
    """Sections without keys, and keys that need another key."""
    for name, needed in _NEEDED.items():
        section: Section | None = getattr(settings, name)
        if section is None:
            continue
        keys = section.model_fields_set
        if not keys:
            yield f"'{name}' has no keys: give one, or set {name} to null"
        for key, other in needed.items():
            if key in keys and other not in keys:
                yield f"'{name}.{key}' needs '{name}.{other}': give both, or neither"


def _in_lists(settings: "Settings") -> Iterator[str]:
    lists = {
        "accept": settings.accept,
        "validation.expected_most_worn": settings.validation.expected_most_worn,
    }
    for key, entries in lists.items():
        if twice := sorted({entry for entry in entries if entries.count(entry) > 1}):
            yield f"'{key}' has {twice} more than once: give each once"
    for entry in settings.accept:
        name, colon, _ = entry.partition(":")
        if name not in FAULTS:
            yield (
                f"'accept' has {entry!r}, which is not the name of a fault: {near(name, FAULTS)}"
                f"write one of {', '.join(FAULTS)}"
            )
        elif colon and settings.patches is None:
            yield f"'accept' has {entry!r}, but the study has no patches: write {name} alone"


def _in_squares(settings: "Settings") -> Iterator[str]:
    """Corners that do not lie on a square of any size, and patches larger than the square."""
    corners = {"square.points_mm": settings.square.points_mm}
    tool = settings.counterface
    if tool and tool.pose and tool.pose.points_mm:
        corners["counterface.pose.points_mm"] = tool.pose.points_mm
    for key, points in corners.items():
        try:
            frame_from_points(points)
        except ConfigError as error:
            yield f"'{key}': {error.problem}: {error.remedy}"
    patch_mm, size_mm = settings.scans.size_mm, settings.square.size_mm
    if patch_mm > size_mm:
        yield (
            f"'scans.size_mm' is {patch_mm}, more than the square's {size_mm} mm: a patch must "
            "fit in the square"
        )


def _in_load(settings: "Settings") -> Iterator[str]:
    """Problems of the load, the pressure cap and the face."""
    load = settings.load.model_dump()
    given = [name for name in ("force_N", "pressure_MPa") if load[name] is not None]
    if len(given) > 1:
        yield "'load' has both of force_N and pressure_MPa: set one of them to null"
    if not given:
        yield "'load' has neither of force_N and pressure_MPa: give one"
    if len(given) != 1:
        return
    size_mm = settings.square.size_mm
    pressure = load_force(load, size_mm) / size_mm**2
    cap = settings.pressure_cap_MPa
    if cap is not None and cap <= pressure:
        yield (
            f"'pressure_cap_MPa' is {cap} MPa, not above the mean pressure on the square, "
            f"{pressure:.4g} MPa, so no contact carries the load: raise it, or set it to null"
        )
    if settings.coupling == "paper":
        return
    face_mm = settings.macroscale.face_mm
    if face_mm < size_mm:
        yield (
            f"'macroscale.face_mm' is {face_mm:g}, less than the square's {size_mm:g} mm, but the "
            "face contains the square: make it larger"
        )
    low, high = (size_mm - face_mm) / 2, (size_mm + face_mm) / 2
    if not all(low < along < high for along in resolved_load_point(load, size_mm)):
        yield (
            f"'load.at_mm' is {load['at_mm']}, outside the face, which reaches from {low:g} to "
            f"{high:g} mm, so the stone would tip over: move it inside"
        )


def _in_use(settings: "Settings") -> Iterator[str]:
    """Settings under which nothing can be inferred, or strikes reach beyond the face."""
    use = settings.use
    if use is None or settings.coupling != "equilibrium":
        return
    face_mm = settings.macroscale.face_mm
    gesture, tool = settings.gesture, settings.counterface
    for key, reach_mm, other in (
        ("scatter_mm", 2 * use.scatter_mm, "load_point_scatter_mm"),
        ("stroke_mm", use.stroke_mm, "stroke_mm"),
    ):
        if reach_mm > face_mm:
            yield (
                f"'use.{key}' is {getattr(use, key):g}, but such strikes reach over {reach_mm:g} "
                f"mm of a face of {face_mm:g} mm: lower it, or raise macroscale.face_mm"
            )
        moved = gesture and getattr(gesture, other)
        if reach_mm == 0 and moved:
            yield (
                f"'use.{key}' is 0, but gesture.{other} is {moved:g}, so the inference would "
                "exclude this motion: raise the former, or set the latter to 0"
            )
    errors = settings.uncertainty
    has_radius = tool is not None and tool.radius_mm is not None
    free = errors.load_point_mm, use.scatter_mm, use.stroke_mm
    if not any(free) and not (has_radius and errors.radius_log_sd):
        yield (
            "'uncertainty.load_point_mm', 'uncertainty.radius_log_sd', 'use.scatter_mm' and "
            "'use.stroke_mm' leave nothing to infer: raise one of them, or set use to null"
        )
