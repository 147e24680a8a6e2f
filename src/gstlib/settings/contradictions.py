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

# Whether there is a contradiction, and its text.
_Problems = Iterator[tuple[bool, str]]


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
    yield from (
        text for check in checks for is_wrong, text in check(settings) if is_wrong
    )


def near(name: str, possible: Collection[str]) -> str:
    """The closest of the `possible` names, as the start of a remedy; "" if none is close."""
    meant = difflib.get_close_matches(name, possible, n=1)
    return f"did you mean {meant[0]}? " if meant else ""


def _sources(settings: "Settings") -> _Problems:
    yield (
        (settings.specimen is None) == (settings.inputs is None),
        "give exactly one of 'specimen' (generated) and 'inputs' (your files), and set the other "
        "to null",
    )
    short, long = settings.texture.s_filter_um, settings.texture.l_filter_um
    yield (
        long is not None and long <= short,
        f"'texture.l_filter_um' is {long}, not above texture.s_filter_um, {short}, so no wave "
        "passes both filters: raise it, or set it to null",
    )
    material, layer = settings.material, settings.interlayer
    stones_MPa = min(material.young_1_MPa, material.young_2_MPa)
    if layer is not None:
        yield (
            layer.young_MPa >= stones_MPa,
            f"'interlayer.young_MPa' is {layer.young_MPa:g}, not below the stones' "
            f"{stones_MPa:g} MPa, but an interlayer must be softer than the stones: lower it, or "
            "set interlayer to null",
        )
        element_um = 1e3 * settings.square.size_mm / settings.macroscale.grid
        thinnest_um = element_um / LONGEST_ELEMENT
        yield (
            layer.thickness_um < thinnest_um,
            f"'interlayer.thickness_um' is {layer.thickness_um:g}, below {thinnest_um:.3g}, a "
            f"{LONGEST_ELEMENT}th of the macroscale's elements: make it thicker, raise "
            "macroscale.grid, or set interlayer to null",
        )


def _counterface(settings: "Settings") -> _Problems:
    tool = settings.counterface
    is_paper = settings.coupling == "paper"
    is_generated = settings.specimen and settings.specimen.counterface_seed is not None
    has_mesh = tool is not None and tool.mesh is not None
    has_radius = tool is not None and tool.radius_mm is not None
    yield (
        is_paper and bool(has_mesh or is_generated),
        "'counterface.mesh' (or specimen.counterface_seed) does not go with coupling paper, which "
        "presses a flat: set coupling to equilibrium",
    )
    is_inferred = settings.use is not None and not is_paper
    yield (
        is_inferred
        and settings.uncertainty.radius_log_sd < 0.7
        and not (has_radius or has_mesh),
        "'uncertainty.radius_log_sd' is the error of a radius, but 'counterface' is a flat without "
        "one: give counterface.radius_mm, or leave radius_log_sd out",
    )
    yield (
        has_mesh and has_radius,
        "'counterface' has a radius and a mesh: give one of them",
    )
    if tool is not None and tool.pose is not None:
        yield (
            len(tool.pose.model_fields_set) != 1,
            "'counterface.pose' needs either points_mm or matrix: give exactly one of them",
        )


def _gesture(settings: "Settings") -> _Problems:
    law = settings.wear_law
    has_layer = settings.interlayer is not None
    moves = settings.gesture is not None
    yield (
        moves and settings.coupling == "paper",
        "'gesture' does not go with coupling paper: set coupling to equilibrium, or gesture to "
        "null",
    )
    yield (
        moves and has_layer,
        "'gesture' and 'interlayer' cannot be combined: set one of them to null",
    )
    yield (
        (moves or has_layer) and (law.threshold_MPa, law.exponent) != (0, 1),
        "'wear_law' is not Archard's, which gesture and interlayer need: set both of them to "
        "null, or leave wear_law out",
    )
    keys = settings.gesture.model_fields_set if settings.gesture else set()
    yield (
        "table" in keys and len(keys) > 1,
        f"'gesture' has a table and other keys: {_A_GESTURE}",
    )
    yield keys == {"poses"}, f"'gesture' has poses alone: {_A_GESTURE}"
    yield (
        {"stroke_mm", "load_point_scatter_mm"} <= keys,
        "'gesture' has stroke_mm and load_point_scatter_mm: give one of them",
    )


def _without_patches(settings: "Settings") -> _Problems:
    if settings.patches is not None:
        return
    yield (
        settings.gesture is None,
        "'patches' and 'gesture' are null: proposed positions depend on the scatter of the load "
        "point. Set gesture, such as {load_point_scatter_mm: 1, poses: 60}, or give a patch table",
    )
    tool = settings.counterface
    needing = {
        "published": settings.published,
        "interlayer": settings.interlayer,
        "counterface.scan": tool and tool.scan,
    }
    for name, value in needing.items():
        yield (
            value is not None,
            f"'patches' is null, and {name} needs scanned patches: set it to null or remove it, "
            "or give a patch table",
        )


def _missing_keys(settings: "Settings") -> _Problems:
    """Sections without keys, and keys that need another key."""
    for name, needed in _NEEDED.items():
        section: Section | None = getattr(settings, name)
        if section is None:
            continue
        keys = section.model_fields_set
        yield not keys, f"'{name}' has no keys: give one, or set {name} to null"
        for key, other in needed.items():
            yield (
                key in keys and other not in keys,
                f"'{name}.{key}' needs '{name}.{other}': give both, or neither",
            )


def _in_lists(settings: "Settings") -> _Problems:
    lists = {
        "accept": settings.accept,
        "validation.expected_most_worn": settings.validation.expected_most_worn,
    }
    for key, entries in lists.items():
        twice = sorted({entry for entry in entries if entries.count(entry) > 1})
        yield bool(twice), f"'{key}' has {twice} more than once: give each once"
    for entry in settings.accept:
        name, colon, _ = entry.partition(":")
        yield (
            name not in FAULTS,
            f"'accept' has {entry!r}, which is not the name of a fault: {near(name, FAULTS)}write "
            f"one of {', '.join(FAULTS)}",
        )
        yield (
            name in FAULTS and bool(colon) and settings.patches is None,
            f"'accept' has {entry!r}, but the study has no patches: write {name} alone",
        )


def _in_squares(settings: "Settings") -> _Problems:
    """Corners that do not lie on a square of any size, and patches larger than the square."""
    corners = {"square.points_mm": settings.square.points_mm}
    tool = settings.counterface
    if tool is not None and tool.pose is not None and tool.pose.points_mm is not None:
        corners["counterface.pose.points_mm"] = tool.pose.points_mm
    for key, points in corners.items():
        try:
            frame_from_points(points)
        except ConfigError as error:
            yield True, f"'{key}': {error.problem}: {error.remedy}"
    patch_mm, size_mm = settings.scans.size_mm, settings.square.size_mm
    yield (
        patch_mm > size_mm,
        f"'scans.size_mm' is {patch_mm}, more than the square's {size_mm} mm: a patch must fit in "
        "the square",
    )


def _in_load(settings: "Settings") -> _Problems:
    """Problems of the load, the pressure cap and the face."""
    load = settings.load.model_dump()
    has_force, has_pressure = (
        load[name] is not None for name in ("force_N", "pressure_MPa")
    )
    yield (
        has_force and has_pressure,
        "'load' has both of force_N and pressure_MPa: set one of them to null",
    )
    yield (
        not (has_force or has_pressure),
        "'load' has neither of force_N and pressure_MPa: give one",
    )
    if has_force == has_pressure:
        return
    size_mm = settings.square.size_mm
    pressure = load_force(load, size_mm) / size_mm**2
    cap = settings.pressure_cap_MPa
    yield (
        cap is not None and cap <= pressure,
        f"'pressure_cap_MPa' is {cap} MPa, not above the mean pressure on the square, "
        f"{pressure:.4g} MPa, so no contact carries the load: raise it, or set it to null",
    )
    if settings.coupling == "paper":
        return
    face_mm = settings.macroscale.face_mm
    yield (
        face_mm < size_mm,
        f"'macroscale.face_mm' is {face_mm:g}, less than the square's {size_mm:g} mm, but the face "
        "contains the square: make it larger",
    )
    low, high = (size_mm - face_mm) / 2, (size_mm + face_mm) / 2
    yield (
        not all(low < along < high for along in resolved_load_point(load, size_mm)),
        f"'load.at_mm' is {load['at_mm']}, outside the face, which reaches from {low:g} to "
        f"{high:g} mm, so the stone would tip over: move it inside",
    )


def _in_use(settings: "Settings") -> _Problems:
    """Settings under which nothing can be inferred, or strikes reach beyond the face."""
    use = settings.use
    if use is None or settings.coupling != "equilibrium":
        return
    face_mm = settings.macroscale.face_mm
    gesture, tool = settings.gesture, settings.counterface
    for key, times, other in (
        ("scatter_mm", 2, "load_point_scatter_mm"),
        ("stroke_mm", 1, "stroke_mm"),
    ):
        value = getattr(use, key)
        reach_mm = times * value
        yield (
            reach_mm > face_mm,
            f"'use.{key}' is {value:g}, but such strikes reach over {reach_mm:g} mm of a face of "
            f"{face_mm:g} mm: lower it, or raise macroscale.face_mm",
        )
        moved = gesture and getattr(gesture, other)
        yield (
            value == 0 and bool(moved),
            f"'use.{key}' is 0, but gesture.{other} is {moved or 0:g}, so the inference would "
            "exclude this motion: raise the former, or set the latter to 0",
        )
    errors = settings.uncertainty
    is_round = tool is not None and tool.radius_mm is not None
    free = errors.load_point_mm, use.scatter_mm, use.stroke_mm
    yield (
        not any(free) and not (is_round and errors.radius_log_sd),
        "'uncertainty.load_point_mm', 'uncertainty.radius_log_sd', 'use.scatter_mm' and "
        "'use.stroke_mm' leave nothing to infer: raise one of them, or set use to null",
    )
