"""The study's configuration, completed and checked as a whole before anything runs.

Omitted keys take their defaults from `workflow/schemas/config.schema.yaml`. The completed
config is checked against that schema, and then against the rules that a schema cannot
express. All problems are reported at once, each with its key, its value and the remedy.
"""

import copy
import difflib
import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError

from gst import ROOT
from gst.config_file import read_config_file
from gstlib.conditions import load_force, load_point
from gstlib.errors import ConfigError, InputError
from gstlib.io.files import LARGEST_TABLE, check_size, name_problem
from gstlib.surfaces.frames import frame_from_points

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "check_files",
    "complete",
    "config_problems",
    "counterface_mesh",
    "read_config",
    "read_study",
    "refuse_config",
    "refuse_study",
    "resolved",
]

_SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"
# Corners are clicked or typed: the square's sides may be off by this share.
_SIDE_TOLERANCE = 0.1
# ASSUME: no stone bears a mean pressure (MPa) like this; quartzite is crushed at 150 to 300 MPa.
_CRUSHING_MPA = 1000.0
# No length, force or seed is larger; sums and squares of such numbers stay finite.
_LARGEST_NUMBER = 1e15
# A number with a decimal comma, which YAML takes for text.
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def refuse_config(problems: Iterable[str], source: str) -> None:
    """Raise a `ConfigError` that lists the problems of the config file `source`, if any."""
    if listed := "".join(f"\n  - {problem}" for problem in problems):
        problem = f"the configuration cannot be used{listed}\n "
        raise ConfigError(source, problem, "See config/README.md for all keys.")


def complete(config: Mapping) -> dict:
    """A config with the defaults of all omitted keys; `config` is not altered.

    In a section given in part, the other keys take their defaults. A null stays null, and a
    list replaces a default list. Nothing is checked: unknown keys and values of a wrong type stay.
    """
    whole = _validator().schema
    return _completed(config, whole, whole)


def _completed(value: Any, rule: Mapping, schema: Mapping) -> Any:
    """A value, completed if its rule describes a section."""
    rules = [resolved(part, schema) for part in (rule, *rule.get("oneOf", ()))]
    keys = next((part["properties"] for part in rules if "properties" in part), None)
    if keys is None or not isinstance(value, Mapping):
        return copy.deepcopy(value)
    defaults = {name: part["default"] for name, part in keys.items() if "default" in part}
    return {
        name: _completed(part, keys.get(name, {}), schema)
        for name, part in (defaults | dict(value)).items()
    }


def resolved(rule: Mapping, schema: Mapping) -> dict:
    """A rule of the schema, merged with the one in ``$defs`` that it refers to, if any."""
    name = rule.get("$ref", "").removeprefix("#/$defs/")
    return {**schema["$defs"][name], **rule} if name else dict(rule)


def read_config(path: str | Path) -> dict:
    """The config of a file, defaults included."""
    return complete(read_config_file(path))


def read_study(config: Mapping, source: str) -> "pd.DataFrame":
    """Check a config, defaults included, and read its patch table.

    `source` names the config in messages.

    Raises
    ------
    ConfigError
        Its message lists all that is wrong with the config, or with the table.

    Notes
    -----
    Without a patch table, the table has no rows.
    """
    from gst.patches import no_patches, read_patches

    refuse_config(config_problems(config), source)
    if config["patches"] is None:
        return no_patches()
    return read_patches(
        config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
        scan_folder=config["inputs"]["scan_folder"] if config["inputs"] else None,
    )


def refuse_study(config: Mapping, source: str) -> None:
    """Refuse what would stop a run before its first step, in sentences of gst alone.

    `config` has its defaults; `source` names it in messages.

    Raises
    ------
    ConfigError
        The config, its patch table or its table of poses cannot be used, or a measured file is
        missing.
    """
    from gst.poses import poses_of

    patches = read_study(config, source)
    poses_of(config)
    if config["inputs"] is not None:
        check_files(config, patches, ", ".join(filter(None, [source, config["patches"]])))


def config_problems(config: Mapping) -> list[str]:
    """Everything that is wrong with a whole config, one sentence each; empty if it can be used."""
    # A schema cannot express these, and lets NaN pass every bound.
    if unusable := list(_unusable_values(config)):
        return unusable
    errors = list(_leaves(_validator().iter_errors(config)))
    # Branches of `oneOf` may give the same message.
    explained = list(dict.fromkeys(_explain(e) for e in errors if not _has_commas(e)))
    if commas := dict.fromkeys(
        f"'{_key(e)}' is {e.instance}" for e in errors if _has_commas(e)
    ):
        explained.insert(0, f"{', '.join(commas)}: write decimal points, not commas")
    # The contradictions rely on correct types.
    return explained or list(_contradictions(config))


def _unusable_values(value: Any, key: str = "") -> Iterator[str]:
    """Numbers that are not finite or far too large, and text that cannot be a path."""
    if isinstance(value, Mapping | list):
        parts = value.items() if isinstance(value, Mapping) else enumerate(value)
        for name, part in parts:
            yield from _unusable_values(part, f"{key}.{name}" if key else str(name))
    elif isinstance(value, str):
        # a title may be long: its characters alone matter
        texts = value if key == "title" else [value]
        if problem := next(filter(None, map(name_problem, texts)), None):
            yield f"'{key}' {problem}: shorten or correct it"
    elif isinstance(value, int | float) and not abs(value) <= _LARGEST_NUMBER:
        # a whole number may have more digits than can be written
        shown = f"{value}" if isinstance(value, float) else f"about 2^{value.bit_length()}"
        yield f"'{key}' is {shown}: give a finite number, at most {_LARGEST_NUMBER:g}"


def _has_commas(error: ValidationError) -> bool:
    """Whether numbers were written with decimal commas; in a list they look like twice as many."""
    value, asked = error.instance, error.validator_value
    if error.validator == "maxItems":
        return len(value) == 2 * asked and all(isinstance(part, int) for part in value)
    is_text = error.validator == "type" and isinstance(value, str)
    return is_text and _DECIMAL_COMMA.fullmatch(value) is not None


def _key(error: ValidationError) -> str:
    return ".".join(str(part) for part in error.absolute_path)


@functools.cache
def _validator() -> Draft202012Validator:
    text = _SCHEMA.read_text(encoding="utf-8")
    return Draft202012Validator(yaml.safe_load(text))


def check_files(config: Mapping, patches: "pd.DataFrame", source: str) -> None:
    """Refuse measured files that are missing, or whose names Snakemake cannot use.

    Parameters
    ----------
    config : mapping
        The whole configuration, with ``inputs``.
    patches : pandas.DataFrame
        The patch table (`gst.patches.read_patches`).
    source : str
        Where the files are named, for the message.

    Raises
    ------
    ConfigError
        Its message lists every such file.
    """
    from gst.patches import EPOCHS, at_epoch

    files = {"mesh": config["inputs"]["mesh"]}
    second = config["counterface"] or {}
    files |= {f"counterface's {of}": second[of] for of in ("mesh", "scan") if of in second}
    for row in patches.itertuples():
        for column, epoch in EPOCHS.items():
            if name := getattr(row, column):
                what = at_epoch(row.patch, epoch)
                files[what] = f"{config['inputs']['scan_folder']}/{name}"
    found = {what: _path_problem(path, files.values()) for what, path in files.items()}
    if faults := [f"\n  - {what}: {problem}" for what, problem in found.items() if problem]:
        raise ConfigError(
            source,
            f"{len(faults)} of {len(files)} files cannot be used{''.join(faults)}\n ",
            "Put them there, or correct their names; paths are relative to the working folder.",
        )


def _path_problem(path: str, named: Iterable[str] = ()) -> str | None:
    """What is wrong with the path of a file, if anything; `named` are all files of the config."""
    if set("{}") & set(path):
        return f"{path} contains braces, which Snakemake reads as a placeholder"
    if Path(path).is_file():
        return None
    # Names that differ only in case come first; a file that is named elsewhere is not meant.
    folder, taken = Path(path).parent, {Path(other) for other in named}
    there = folder.iterdir() if folder.is_dir() else ()
    free = {file.name.casefold(): file.name for file in there if file not in taken}
    near = difflib.get_close_matches(Path(path).name.casefold(), free, n=1)
    return f"{path} does not exist" + "".join(f" (did you mean {free[name]}?)" for name in near)


def _leaves(errors: Iterable[ValidationError]) -> Iterator[ValidationError]:
    """The errors themselves, in place of the `oneOf` [null, the real rule] that hides them."""
    for error in sorted(errors, key=lambda error: [str(part) for part in error.absolute_path]):
        if error.validator == "oneOf":
            yield from _leaves(e for e in error.context or [] if e.validator_value != "null")
        else:
            yield error


def _explain(error: ValidationError) -> str:
    key = _key(error)
    if error.validator == "additionalProperties":
        known = error.schema["properties"]
        unknown = sorted(set(error.instance) - set(known))
        place = f"'{key}' has" if key else "there are"
        near = {key: difflib.get_close_matches(key, known, n=1) for key in map(str, unknown)}
        meant = ", ".join(f"{name} for {key}" for key, names in near.items() for name in names)
        hint = f"did you mean {meant}? " if meant else ""
        remedy = f"remove or correct them ({hint}known: {sorted(known)})"
        return f"{place} unknown keys {unknown}: {remedy}"
    if error.validator == "required":
        return f"'{key}' lacks {sorted(set(error.validator_value) - set(error.instance))}: add them"
    # the description of a `oneOf` [null, the real rule] stands beside it
    asked = [error.schema, error.parent.schema if error.parent else {}]
    description = next((rule["description"] for rule in asked if "description" in rule), "")
    wish = f" [{description}]" if description else ""
    if error.validator == "pattern":  # which is for the machine
        return f"'{key}' is {error.instance!r}:{wish}"
    if error.validator == "type" and isinstance(error.instance, str):
        wish = f" (write a number without quotes, such as 20 or 1.0e-9){wish}"
    # a value may be as long as the file
    return f"'{key}' is {error.instance!r:.1000}: {error.message:.1000}{wish}"


def _contradictions(config: Mapping) -> Iterator[str]:
    if (config["specimen"] is None) == (config["inputs"] is None):
        yield (
            "give exactly one of 'specimen' (generated) and 'inputs' (your files); set the other "
            "to null"
        )
    if (inside := _inputs_in_results(config)) is not None:
        yield (
            f"'results' is {config['results']!r}, a folder that contains {inside}: name a folder "
            "for the results alone"
        )
    square, pose = config["square"], (config["counterface"] or {}).get("pose", {})
    yield from _square_problems("square.points_mm", square["points_mm"], square["size_mm"])
    if "points_mm" in pose:
        yield from _square_problems(
            "counterface.pose.points_mm", pose["points_mm"], square["size_mm"]
        )
    yield from _patches_problems(config)
    if config["scans"]["size_mm"] > square["size_mm"]:
        yield (
            f"'scans.size_mm' is {config['scans']['size_mm']}, more than the square's "
            f"{square['size_mm']} mm: a patch must fit in the square"
        )
    yield from _load_problems(config)
    interlayer, stones = (
        config["interlayer"],
        [config["material"][f"young_{stone}_MPa"] for stone in (1, 2)],
    )
    if interlayer is not None and interlayer["young_MPa"] >= min(stones):
        yield (
            f"'interlayer.young_MPa' is {interlayer['young_MPa']:g}, not below the stones' "
            f"{min(stones):g} MPa: an interlayer must be softer than the stones; lower it, or set "
            "interlayer to null"
        )
    if interlayer is not None and config["specimen"] is not None:
        spacing_um = config["specimen"]["scan_spacing_um"]
        if interlayer["thickness_um"] < spacing_um:
            fault = thinner_than_a_point(interlayer["thickness_um"], spacing_um)
            yield f"'interlayer.thickness_um': {fault}; make it thicker, or set interlayer to null"
    if config["gesture"] is not None:
        if len(config["gesture"]) != 2 - ("table" in config["gesture"]):
            yield (
                f"'gesture' is {config['gesture']}: give a table, or poses with stroke_mm or "
                "load_point_scatter_mm"
            )
        if config["coupling"] == "levelled":
            yield (
                "'gesture' needs a stone at rest, and coupling is levelled: set coupling to "
                "placed, or gesture to null"
            )
        if interlayer is not None:
            yield "'gesture' and 'interlayer' cannot wear a stone together: set one of them to null"
    short, long = config["texture"]["s_filter_um"], config["texture"]["l_filter_um"]
    if long is not None and long <= short:
        yield (
            f"'texture.l_filter_um' is {long}, not above texture.s_filter_um, {short}: no wave "
            "passes both filters; raise it, or set it to null"
        )
    for name in ("patches", "published"):
        if config[name] is not None:
            if problem := _path_problem(config[name]):
                yield f"'{name}': {problem}: correct the path"
            else:
                yield from _size_problem(name, config[name])


def _size_problem(name: str, path: str) -> Iterator[str]:
    """A table too large for one, which is not read."""
    try:
        check_size(path, LARGEST_TABLE)
    except InputError as error:
        yield f"'{name}': {error}"


def _square_problems(key: str, points: Sequence, size_mm: float) -> Iterator[str]:
    """Corners that make no square, or one of another size."""
    try:
        frame_from_points(points)
    except ConfigError as error:
        yield f"'{key}': {error.problem}: {error.remedy}"
        return
    sides = np.linalg.norm(np.subtract(points[1:], points[0]), axis=1)
    if (abs(sides - size_mm) > _SIDE_TOLERANCE * size_mm).any():
        yield (
            f"'{key}' are corners {sides[0]:.3g} and {sides[1]:.3g} mm apart, and square.size_mm "
            f"is {size_mm:g}: give the points in mm, at the corners of the square, or correct its "
            "size"
        )


def _patches_problems(config: Mapping) -> Iterator[str]:
    """What is wrong with the patches, or with a study that has none."""
    inputs = config["inputs"]
    if config["patches"] is not None:
        if inputs is not None and inputs["scan_folder"] is None:
            yield "'inputs' lacks ['scan_folder'], where the scans of the patch table are: add it"
        return
    if config["gesture"] is None:
        yield (
            "'patches' and 'gesture' are null: where to scan depends on how the load point "
            "scatters; set gesture, such as {load_point_scatter_mm: 1, poses: 60}, or give a patch "
            "table"
        )
    idle = [name for name in ("published", "interlayer") if config[name] is not None]
    idle += ["counterface.scan"] if "scan" in (config["counterface"] or {}) else []
    if idle:
        yield (
            f"'patches' is null, and {' and '.join(idle)} need{'s' * (len(idle) == 1)} scanned "
            "patches: take out what needs them, or give a patch table"
        )


def _load_problems(config: Mapping) -> Iterator[str]:
    """What is wrong with the load, with what bears it, and with what presses."""
    load, size_mm = config["load"], config["square"]["size_mm"]
    if (load["force_N"] is None) == (load["pressure_MPa"] is None):
        both = "both" if load["force_N"] is not None else "neither"
        yield f"'load' has {both} of force_N and pressure_MPa: give one, and set the other to null"
        return
    pressure = load_force(load, size_mm) / size_mm**2
    if config["pressure_cap_MPa"] is not None and config["pressure_cap_MPa"] <= pressure:
        yield (
            f"'pressure_cap_MPa' is {config['pressure_cap_MPa']} MPa, not above the mean pressure "
            f"on the square, {pressure:.4g} MPa: no contact bears more than that; raise it, or set "
            "it to null"
        )
    if pressure > _CRUSHING_MPA:
        yield (
            f"'load' presses the square of {size_mm:g} mm with {pressure:.4g} MPa on average, and "
            "no stone bears that (quartzite is crushed at 150 to 300 MPa): give the force of use "
            "in N, which for a hand is some tens to some hundreds"
        )
    form = config["counterface"] or {}
    if form.get("radius_mm") and "mesh" in form:
        yield "'counterface' has a radius and a mesh: give one of them"
    if config["coupling"] == "levelled":
        if counterface_mesh(config, "") is not None:
            yield (
                "'counterface.mesh' (or specimen.counterface_seed) needs a stone at rest, and "
                "coupling is levelled, which presses a flat: set coupling to placed"
            )
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


def counterface_mesh(config: Mapping, specimen: str) -> dict | None:
    """The active tool: its ``mesh``, ``mesh_unit`` and ``pose``; None if it is flat.

    `specimen` is the folder of a generated active tool, whose square is laid on the passive
    one's.
    """
    generated = config["specimen"] is not None
    if generated and config["specimen"]["counterface_seed"] is not None:
        pose = {"points_mm": config["square"]["points_mm"]}
        return {"mesh": f"{specimen}/counterface.stl", "mesh_unit": "mm", "pose": pose}
    given = config["counterface"] or {}
    if "mesh" not in given:
        return None
    # no default of the schema, which a stone without a mesh would get, too
    return {"mesh_unit": "mm"} | {name: of for name, of in given.items() if name != "scan"}


def thinner_than_a_point(thickness_um: float, spacing_um: float) -> str:
    """What is wrong with an interlayer that is thinner than the spacing of the scans' points."""
    return (
        f"{thickness_um:g} µm is less than the {spacing_um:.3g} µm between two points of a scan: "
        "so thin an interlayer has no measurable effect"
    )


def _inputs_in_results(config: Mapping) -> str | None:
    """An input of the study, or the working folder, that lies in the folder of the results."""
    folder = Path(config["results"]).resolve()
    files = {"the working folder": ".", "the patch table": config["patches"]}
    files["the published figures"] = config["published"]
    if config["inputs"] is not None:
        files |= {
            "the mesh": config["inputs"]["mesh"],
            "the scans": config["inputs"]["scan_folder"],
        }
    second = config["counterface"] or {}
    files |= {f"the counterface's {of}": second.get(of) for of in ("mesh", "scan")}
    files["the poses"] = (config["gesture"] or {}).get("table")
    for name, file in files.items():
        if file is not None and Path(file).resolve().is_relative_to(folder):
            return f"{name} ({file})"
    return None
