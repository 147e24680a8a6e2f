"""Contradictions in settings. Each message names key, value and remedy."""

import difflib
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from gstlib.conditions import load_force, resolved_load_point
from gstlib.errors import FAULTS, ConfigError
from gstlib.settings.sections import Section
from gstlib.surfaces.frames import frame_from_points

if TYPE_CHECKING:
    from gstlib.settings import Settings

__all__ = ["contradictions", "near"]

_ONE_SOURCE = (
    "give exactly one of 'specimen' (generated) and 'inputs' (your files), and set the other to "
    "null"
)
_AT_REST = (
    "'counterface.mesh' (or specimen.counterface_seed) does not go with coupling paper, "
    "which presses a flat: set coupling to equilibrium"
)
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
    checks = _sources, _counterface, _gesture, _without_patches
    yield from (
        text for check in checks for is_wrong, text in check(settings) if is_wrong
    )
    yield from _missing_keys(settings)
    yield from _in_lists(settings)
    yield from _in_squares(settings)
    load = settings.load
    if (load.force_N is None) == (load.pressure_MPa is None):
        if load.force_N is None:
            yield "'load' has neither of force_N and pressure_MPa: give one"
        else:
            yield "'load' has both of force_N and pressure_MPa: set one of them to null"
    else:
        yield from _in_load(settings)
    yield from _in_use(settings)


def near(name: str, possible: Collection[str]) -> str:
    """The closest of the `possible` names, as the start of a remedy; "" if none is close."""
    meant = difflib.get_close_matches(name, possible, n=1)
    return f"did you mean {meant[0]}? " if meant else ""


def _sources(settings: "Settings") -> Iterator[tuple[bool, str]]:
    """Whether there is a contradiction, and its text."""
    yield (settings.specimen is None) == (settings.inputs is None), _ONE_SOURCE
    short = settings.texture.s_filter_um
    long = settings.texture.l_filter_um
    yield (
        long is not None and long <= short,
        f"'texture.l_filter_um' is {long}, not above texture.s_filter_um, {short}, so no wave "
        "passes both filters: raise it, or set it to null",
    )
    layer = settings.interlayer
    material = settings.material
    stones_MPa = min(material.young_1_MPa, material.young_2_MPa)
    if layer is not None:
        yield (
            layer.young_MPa >= stones_MPa,
            f"'interlayer.young_MPa' is {layer.young_MPa:g}, not below the stones' "
            f"{stones_MPa:g} MPa, but an interlayer must be softer than the stones: lower it, or "
            "set interlayer to null",
        )


def _counterface(settings: "Settings") -> Iterator[tuple[bool, str]]:
    tool = settings.counterface
    is_paper = settings.coupling == "paper"
    specimen = settings.specimen
    has_mesh = tool is not None and tool.mesh is not None
    is_flat = tool is None or (tool.radius_mm is None and not has_mesh)
    yield (
        is_paper
        and (
            has_mesh or (specimen is not None and specimen.counterface_seed is not None)
        ),
        _AT_REST,
    )
    yield (
        settings.use is not None
        and not is_paper
        and settings.uncertainty.radius_log_sd < 0.7
        and is_flat,
        "'uncertainty.radius_log_sd' is the error of a radius, but 'counterface' is a flat without "
        "one: give counterface.radius_mm, or leave radius_log_sd out",
    )
    if tool is None:
        return
    yield (
        has_mesh and tool.radius_mm is not None,
        "'counterface' has a radius and a mesh: give one of them",
    )
    yield (
        tool.pose is not None and len(tool.pose.model_fields_set) != 1,
        "'counterface.pose' needs either points_mm or matrix: give exactly one of them",
    )


def _gesture(settings: "Settings") -> Iterator[tuple[bool, str]]:
    gesture = settings.gesture
    law = settings.wear_law
    has_layer = settings.interlayer is not None
    moves = gesture is not None
    yield (
        moves and settings.coupling == "paper",
        "'gesture' does not go with coupling paper: set coupling to equilibrium, or "
        "gesture to null",
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
    if gesture is None:
        return
    keys = gesture.model_fields_set
    yield (
        "table" in keys and len(keys) > 1,
        f"'gesture' has a table and other keys: {_A_GESTURE}",
    )
    yield keys == {"poses"}, f"'gesture' has poses alone: {_A_GESTURE}"
    yield (
        {"stroke_mm", "load_point_scatter_mm"} <= keys,
        "'gesture' has stroke_mm and load_point_scatter_mm: give one of them",
    )


def _without_patches(settings: "Settings") -> Iterator[tuple[bool, str]]:
    if settings.patches is not None:
        return
    yield (
        settings.gesture is None,
        "'patches' and 'gesture' are null: proposed positions depend on the scatter of the load "
        "point. Set gesture, such as {load_point_scatter_mm: 1, poses: 60}, or give a patch table",
    )
    for name in ("published", "interlayer"):
        yield (
            getattr(settings, name) is not None,
            f"'patches' is null, and {name} needs scanned patches: set it to null, or give a "
            "patch table",
        )
    yield (
        settings.counterface is not None and settings.counterface.scan is not None,
        "'patches' is null, and counterface.scan needs scanned patches: remove it, or give a "
        "patch table",
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
                f"'accept' has {entry!r}, which is not the name of a fault: "
                f"{near(name, FAULTS)}write one of {', '.join(FAULTS)}"
            )
        elif colon and settings.patches is None:
            yield f"'accept' has {entry!r}, but the study has no patches: write {name} alone"


def _in_squares(settings: "Settings") -> Iterator[str]:
    yield from _corner_problems("square.points_mm", settings.square.points_mm)
    tool = settings.counterface
    if tool is not None and tool.pose is not None and tool.pose.points_mm is not None:
        yield from _corner_problems("counterface.pose.points_mm", tool.pose.points_mm)
    patch_mm = settings.scans.size_mm
    size_mm = settings.square.size_mm
    if patch_mm > size_mm:
        yield (
            f"'scans.size_mm' is {patch_mm}, more than the square's {size_mm} mm: a patch must "
            "fit in the square"
        )


def _corner_problems(key: str, points: Sequence) -> Iterator[str]:
    """Problems of three corners that do not depend on the size of their square."""
    try:
        frame_from_points(points)
    except ConfigError as error:
        yield f"'{key}': {error.problem}: {error.remedy}"


def _in_load(settings: "Settings") -> Iterator[str]:
    """Problems of the load, the pressure cap and the face."""
    load = settings.load.model_dump()
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
    low = (size_mm - face_mm) / 2
    high = (size_mm + face_mm) / 2
    if not all(low < along < high for along in resolved_load_point(load, size_mm)):
        yield (
            f"'load.at_mm' is {load['at_mm']}, outside the face, which reaches from {low:g} to "
            f"{high:g} mm, so the stone would tip over: move it inside"
        )


def _in_use(settings: "Settings") -> Iterator[str]:
    """Settings under which nothing can be inferred, or strikes reach beyond the face."""
    use = settings.use
    errors = settings.uncertainty
    if use is None or settings.coupling != "equilibrium":
        return
    face_mm = settings.macroscale.face_mm
    gesture = settings.gesture
    for key, times, other in (
        ("scatter_mm", 2, "load_point_scatter_mm"),
        ("stroke_mm", 1, "stroke_mm"),
    ):
        value = getattr(use, key)
        if (reach_mm := times * value) > face_mm:
            yield (
                f"'use.{key}' is {value:g}, but such strikes reach over {reach_mm:g} mm of a "
                f"face of {face_mm:g} mm: lower it, or raise macroscale.face_mm"
            )
        moved = gesture and getattr(gesture, other)
        if value == 0 and moved:
            yield (
                f"'use.{key}' is 0, but gesture.{other} is {moved:g}, so the inference would "
                "exclude this motion: raise the former, or set the latter to 0"
            )
    is_round = (
        settings.counterface is not None and settings.counterface.radius_mm is not None
    )
    free = errors.load_point_mm, use.scatter_mm, use.stroke_mm
    if not any(free) and not (is_round and errors.radius_log_sd):
        yield (
            "'uncertainty.load_point_mm', 'uncertainty.radius_log_sd', 'use.scatter_mm' and "
            "'use.stroke_mm' leave nothing to infer: raise one of them, or set use to null"
        )
