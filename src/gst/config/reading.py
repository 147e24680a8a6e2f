"""The study's configuration: read, completed and checked as a whole before anything runs.

Keys left out take their defaults from `gstlib.settings`. The whole config is checked against the
schema that comes from there, then for contradictions of its values and of the files that it names
(`gst.config.contradictions`). All problems are reported at once, each with its key, its value and
the remedy.
"""

import copy
import functools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError
from pydantic import ValidationError as SettingsError

from gst.config.contradictions import check_files, file_problems, improbable
from gst.config.patches import no_patches, read_patches
from gst.config.poses import poses_of
from gst.config.published import read_published
from gst.config.renamed import COUPLINGS, KEYS
from gst.config.strict_yaml import read_yaml
from gst.config.todo import is_to_do, sentence
from gst.config.user_tables import cells_to_do
from gstlib.conditions import rounded_form
from gstlib.errors import ConfigError, InputsError
from gstlib.settings import Settings, json_schema
from gstlib.settings.contradictions import near
from gstlib.use.evidence import FEWEST_PATCHES

# No length, force or seed is larger; sums and squares of such numbers stay finite.
_LARGEST_NUMBER = 1e15
# Control characters but for tabs and ends of lines, and halves of characters.
_IMPOSSIBLE = re.compile(r"[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\U0010ffff]")
# What usually lies behind a value of a wrong kind.
_NUMBER = "write a number with a point and without quotes, such as 20 or 1.0e-9"
_LIST = "write decimal points, not commas"


def read_config_file(path: str | Path) -> dict:
    """The keys and values of a config, nested as in the file, without defaults.

    Raises a `ConfigError` as `gst.config.strict_yaml.read_yaml` does.
    """
    config = read_yaml(path, "Correct its path, or make one with `gst new`.")
    if problem := next(_unusable(config), None):
        raise ConfigError(path, problem, "See config/README.md for all keys.")
    return config


def read_config(path: str | Path) -> dict:
    """The config of a file, defaults included."""
    return complete(read_config_file(path))


def complete(config: Mapping) -> dict:
    """A config with the defaults of all keys left out; `config` is not altered.

    In a section given in part, the other keys take their defaults. A null stays null, and a
    list replaces a default list. Nothing is checked: unknown keys and values of a wrong type stay.
    """
    return _completed(config, _schema())


def _completed(value: Any, rule: Mapping) -> Any:
    """A value, completed if its rule describes a section."""
    if not isinstance(value, Mapping) or "properties" not in rule:
        return copy.deepcopy(value)
    keys = rule["properties"]
    defaults = {
        name: part["default"] for name, part in keys.items() if "default" in part
    }
    return {
        name: _completed(part, keys.get(name, {}))
        for name, part in (defaults | dict(value)).items()
    }


def refuse_config(problems: Iterable[str], source: str) -> None:
    """Raise a `ConfigError` that lists the problems of the config file `source`, if any."""
    if listed := "".join(f"\n  - {problem}" for problem in problems):
        problem = f"the configuration cannot be used{listed}\n "
        raise ConfigError(source, problem, "See config/README.md for all keys.")


def read_study(config: Mapping, source: str) -> pd.DataFrame:
    """Check a config, defaults included, and read its patch table; without one, no rows.

    Raises a `ConfigError` that lists all that is wrong with the config, which it calls `source`,
    or with a table; or the faults of both that the config does not accept.
    """
    refuse_config(config_problems(config), source)
    patches = no_patches()
    if config["patches"] is not None:
        patches = read_patches(
            config["patches"],
            size_mm=config["square"]["size_mm"],
            patch_size_mm=config["scans"]["size_mm"],
            scan_folder=(config["inputs"] or {}).get("scan_folder"),
        )
    if config["published"] is not None:
        read_published(config["published"], [*patches.patch])
    refuse_config(_accepted_patches(config, [*patches.patch]), source)
    faults = improbable(config, patches)
    if stopping := [each for each in faults if not each.is_accepted(config["accept"])]:
        raise InputsError(stopping)
    if config["patches"] is None:
        return patches
    if not (patches.t0 != "").any():
        _refuse_without_scans(config, patches.wear_grade.dropna())
    elif config["inputs"] is not None and config["inputs"]["scan_folder"] is None:
        problem = f"{config['patches']} names scans, and 'inputs' lacks scan_folder"
        raise ConfigError(source, problem, "Give the folder where they are.")
    return patches


def _refuse_without_scans(config: Mapping, grades: pd.Series) -> None:
    """Refuse settings that need scans, for a patch table with grades in their place, or too few."""
    count = len(grades)
    if count < FEWEST_PATCHES or grades.nunique() < 2:
        how = (
            f"only {count} of its patches"
            if count < FEWEST_PATCHES
            else "all patches the same"
        )
        raise ConfigError(
            config["patches"],
            f"grades {how}, which does not show how the tool was used",
            f"Grade {FEWEST_PATCHES} patches or more, better twenty, with unworn ones.",
        )
    needs = [name for name in ("published", "interlayer") if config[name] is not None]
    if config["gesture"] is None or config["use"] is None or needs:
        raise ConfigError(
            config["patches"],
            "has grades of wear and no scans, for which the config needs gesture and use, and "
            "neither published nor interlayer",
            "Set gesture, such as {load_point_scatter_mm: 1.0, poses: 60}, and use: {}; set "
            f"{' and '.join(needs) or 'nothing else'} to null.",
        )


def _accepted_patches(config: Mapping, patches: Collection[str]) -> Iterator[str]:
    """Each entry of ``accept`` for a patch that is not among the `patches` of the table."""
    for entry in config["accept"]:
        name, colon, patch = entry.partition(":")
        if colon and patch not in patches:
            yield (
                f"'accept' has {entry!r}, and no patch of {config['patches']} has that name: "
                f"{near(patch, patches)}write {name} for all patches"
            )


def asked_of_files(
    config: Mapping, mesh_unit: str, active_tool: Mapping | None
) -> dict[str, Any]:
    """Requirements of a config on the files of its study, for `gst.check.inputs.Asked`.

    `active_tool` is as in `gst.config.contradictions.counterface_mesh`, with ``reach_mm``; None
    without a mesh of it.
    """
    is_equilibrium = config["coupling"] == "equilibrium"
    return {
        "mesh_unit": mesh_unit,
        "face": Settings(**config).by_stage()["grid_macroscale"],
        "rounded": rounded_form(config),
        "scan_settings": config["scans"],
        "maximum_unmeasured": config["preprocessing"]["maximum_unmeasured"],
        "placed": is_equilibrium,
        "reference": is_equilibrium and config["reference_realisations"] is not None,
        "interlayer": config["interlayer"],
        "active_tool": active_tool,
        "accept": config["accept"],
    }


def refuse_study(config: Mapping, source: str) -> None:
    """Refuse settings that would stop a run before its first step, in sentences of gst alone.

    Raises a `ConfigError` if the config, defaults included, its patch table or its table of poses
    cannot be used, or a measured file is missing; `source` names the config.
    """
    patches = read_study(config, source)
    poses_of(config)
    if config["inputs"] is not None:
        check_files(config, patches, source)


def config_problems(config: Mapping) -> list[str]:
    """Everything that is wrong with a whole config, one sentence each; empty if it can be used."""
    # the contradictions rely on correct types
    if unusable := [*_to_do(config)] or value_problems(config):
        return unusable
    contradictions = []
    try:
        Settings(**config)
    except SettingsError as error:
        contradictions = [each["msg"] for each in error.errors()]
    return [*contradictions, *file_problems(config)]


def value_problems(config: Mapping) -> list[str]:
    """Problems of single values, in the order of the keys; not of those still to be given."""
    errors = [error for error in _errors(config) if not is_to_do(error.instance)]
    # each missing key has an error
    return [*_unusable(config), *dict.fromkeys(map(_explain, errors))]


def _to_do(config: Mapping) -> Iterator[str]:
    """Values that `gst new` left to the user, in the config and its patch table."""
    for key, value, rule in _values(config, _schema()):
        if is_to_do(value):
            yield sentence(f"'{key}'", value, rule.get("description", ""))
    table = config.get("patches")
    if isinstance(table, str) and not is_to_do(table) and Path(table).is_file():
        yield from cells_to_do(table, "patches")


def read_unfinished(path: Path) -> dict:
    """Read a config as `read_config` does, in which values may still be given or corrected.

    Raises a `ConfigError` if a value is of another type than its key has.
    """
    config = read_config(path)
    problems = [
        _explain(error)
        for error in _errors(config)
        if error.validator in ("type", "required") and not is_to_do(error.instance)
    ]
    refuse_config(problems, str(path))
    return config


@functools.cache
def _schema() -> dict[str, Any]:
    return json_schema()


def _errors(config: Mapping) -> list[ValidationError]:
    """What the schema refuses, in the order of the keys."""
    return sorted(Draft202012Validator(_schema()).iter_errors(config), key=_key)


def _key(error: ValidationError) -> str:
    """The full name of the key at fault."""
    return ".".join(map(str, error.absolute_path))


def _values(
    section: Any, rule: Mapping, prefix: str = ""
) -> Iterator[tuple[str, Any, Mapping]]:
    """Every value that is no section and no list, with its key and its rule in the schema."""
    parts = section.items() if isinstance(section, Mapping) else enumerate(section)
    rules = rule.get("properties", {})
    for name, value in parts:
        own = rules.get(name, {})
        if isinstance(value, Mapping | list):
            yield from _values(value, own, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value, own


def values_to_do(config: Mapping) -> list[str]:
    """The keys of a config whose values are still to be given."""
    return [key for key, value, _ in _values(config, {}) if is_to_do(value)]


def _unusable(config: Mapping) -> Iterator[str]:
    """Values that no bound and no type of a schema refuses.

    These are numbers that are not finite or far too large, and texts with characters that no name
    of a file can have, and that no page can show.
    """
    for key, value, _ in _values(config, {}):
        if isinstance(value, int | float) and not abs(value) <= _LARGEST_NUMBER:
            yield f"'{key}' is {value}: give a finite number, at most {_LARGEST_NUMBER:g}"
        if isinstance(value, str) and (wrong := _IMPOSSIBLE.search(value)):
            yield f"'{key}' is {value!r}: leave out the character U+{ord(wrong[0]):04X}"


def _explain(error: ValidationError) -> str:
    """The problem with a value, and the required value."""
    key, value = _key(error), error.instance
    if error.validator == "additionalProperties":
        return _unknown_keys(key, set(map(str, value)), error.schema["properties"])
    if error.validator == "required":
        return f"'{key}' lacks {sorted({*error.validator_value} - {*value})}: add them"
    text = f"'{key}' is {value!r:.1000}:"
    if error.validator != "pattern":  # which is for the machine
        text += f" {error.message:.1000}"
    if error.validator == "type" and isinstance(value, str):
        text += f" ({_NUMBER})"
    if error.validator == "maxItems":
        text += f" ({_LIST})"
    if key == "coupling" and isinstance(value, str) and value in COUPLINGS:
        text += f" ({value} is now {COUPLINGS[value]})"
    if description := error.schema.get("description"):
        text += f" [{description}]"
    return text


def _unknown_keys(section: str, names: set[str], rules: Mapping) -> str:
    unknown = sorted(names - rules.keys())
    hints = ""
    for key in unknown:
        if key in KEYS:
            hints += f"{key} is now {KEYS[key]}; "
        elif alike := near(key, rules):
            hints += f"{key}: {alike}"
    place = f"'{section}' has" if section else "there are"
    remedy = f"remove or correct them ({hints}known: {sorted(rules)})"
    return f"{place} unknown keys {unknown}: {remedy}"
