"""The study's configuration, checked as a whole before anything runs.

A config file is held against `workflow/schemas/config.schema.yaml` and against what a schema
cannot say; every problem found is reported at once, with its key, its value and what to do.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import yaml
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match

from gstlib.bem import contact_modulus
from gstlib.errors import ConfigError
from gstlib.preprocess.frame import frame_from_points
from gstlib.sweep.factors import sweep_problems

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "alternative_contact_modulus",
    "check_config",
    "check_files",
    "check_hardness",
    "check_interpreter",
    "faulty_sections",
    "measured_files",
    "study_contact_modulus",
    "study_poisson",
]

# In a path, they are a placeholder to Snakemake.
_BRACES = set("{}")
# What a shell takes a word apart at, or replaces; and braces, which Snakemake replaces.
_NOT_FOR_A_SHELL = re.compile(r"[\s'\"\\$`&;|<>()*?\[\]{}]")


def check_config(config: Mapping, schema: str | Path, source: str) -> None:
    """Refuse a config that the study cannot run with.

    Parameters
    ----------
    config : mapping
        The whole configuration, defaults included.
    schema : path
        Its JSON schema (YAML).
    source : str
        Name of the config file, for the message.

    Raises
    ------
    ConfigError
        Its message lists every problem found.
    """
    problems = _faults(config, schema)
    if not problems and config["sweep"] is not None:
        problems = sweep_problems(config, lambda changed: _faults(changed, schema))
    if problems:
        raise ConfigError(
            source,
            "the configuration cannot be used\n  - " + "\n  - ".join(problems) + "\n ",
            "Every key is described in config/README.md.",
        )


def _faults(config: Mapping, schema: str | Path) -> list[str]:
    """All that a schema says against a config and, if that is nothing, all that it cannot say."""
    problems = [_explain(error) for error in _leaves(_validator(schema).iter_errors(config))]
    return problems or _contradictions(config)  # which relies on the types being right


def faulty_sections(config: Mapping, schema: str | Path) -> set[str]:
    """The top-level keys of a config whose values break its schema, or that are missing."""
    errors = list(_validator(schema).iter_errors(config))
    missing = {name for name in _validator(schema).schema["required"] if name not in config}
    return missing | {str(error.absolute_path[0]) for error in errors if error.absolute_path}


def _validator(schema: str | Path) -> Draft202012Validator:
    return Draft202012Validator(yaml.safe_load(Path(schema).read_text(encoding="utf-8")))


def check_files(files: Mapping[str, str], source: str) -> None:
    """Refuse to start while measured files are missing, or have names that Snakemake cannot take.

    Parameters
    ----------
    files : mapping
        Path of each file by what it is, as in ``{"mesh": "data/tool.stl"}``.
    source : str
        Where the files are named, for the message.

    Raises
    ------
    ConfigError
        Its message lists every such file.
    """
    braced = [f"{what}: {path}" for what, path in files.items() if _BRACES & set(str(path))]
    if braced:
        raise ConfigError(
            source,
            "these paths have braces in them, which Snakemake fills in\n  - "
            + "\n  - ".join(braced)
            + "\n ",
            "Rename the files or folders, and correct their names.",
        )
    missing = [f"{what}: {path}" for what, path in files.items() if not Path(path).is_file()]
    if missing:
        raise ConfigError(
            source,
            f"{len(missing)} of {len(files)} files do not exist\n  - "
            + "\n  - ".join(missing)
            + "\n ",
            "Put the files there, or correct the names (paths are relative to the working folder).",
        )


def check_interpreter(path: str | Path) -> None:
    """Refuse a Python that Snakemake cannot start steps with: it does not quote Python's path.

    Parameters
    ----------
    path : str or Path
        Python's own (``sys.executable``), in ``.venv`` in the project's folder.

    Raises
    ------
    ConfigError
        The path has a blank or another character that a shell does not take as it is.
    """
    found = sorted(set(_NOT_FOR_A_SHELL.findall(str(path))))
    if found:
        marks = ", ".join("a space" if mark == " " else repr(mark) for mark in found)
        raise ConfigError(
            path,
            f"no step can be started with a Python whose path has {marks} in it",
            "Move the project's folder to a path without, remove .venv there and run make "
            "environment; your files and CONFIG may stay where they are.",
        )


def measured_files(config: Mapping, patches: "pd.DataFrame") -> dict[str, str]:
    """Path of each measured file of a study by what it is, for `check_files`.

    Parameters
    ----------
    config : mapping
        The whole configuration, with ``inputs``.
    patches : pandas.DataFrame
        The patch table (`gstlib.io.patches.read_patches`).
    """
    inputs = config["inputs"]
    files = {"mesh": inputs["mesh"]}
    if config["counterface"] is not None:
        files["counterface"] = config["counterface"]["scan"]
    return files | {
        f"patch {row.patch} at {epoch.upper()}": f"{inputs['scan_folder']}/{getattr(row, epoch)}"
        for row in patches.itertuples()
        for epoch in ("t0", "t1")
        if getattr(row, epoch)
    }


def check_hardness(
    hardness_MPa: float | None, pressures_MPa: Mapping[str, float], source: str
) -> None:
    """Refuse a hardness that cannot carry the mean pressure of every patch.

    Parameters
    ----------
    hardness_MPa : float or None
        The ceiling, if the config gives one.
    pressures_MPa : mapping of patch to float
        Target pressure of each patch in the microscale study.
    source : str
        Where the hardness is given, for the message.

    Raises
    ------
    ConfigError
        Names the patches.
    """
    if hardness_MPa is None:
        return
    beyond = [
        f"{patch} ({value:.4g} MPa)"
        for patch, value in pressures_MPa.items()
        if value >= hardness_MPa
    ]
    if beyond:
        raise ConfigError(
            source,
            f"'hardness' is {hardness_MPa:g} MPa, not above the mean pressure of patch "
            + ", ".join(beyond),
            "Raise it, or set it to null.",
        )


def _leaves(errors) -> list[ValidationError]:
    """The errors themselves, not the alternatives (oneOf) that they are hidden in."""
    found = []
    for error in sorted(errors, key=lambda error: [str(part) for part in error.absolute_path]):
        if error.validator == "oneOf" and error.instance is not None:
            found.extend(_leaves(_chosen_branch(error)))
        else:
            found.append(error)
    return found


def _chosen_branch(error: ValidationError) -> list[ValidationError]:
    """Errors of the branch of a `oneOf` that the value was meant for: the one not of type null."""
    branches: dict[int, list[ValidationError]] = {}
    for suberror in error.context:
        branches.setdefault(suberror.schema_path[0], []).append(suberror)
    meant = [
        branch
        for branch in branches.values()
        if not any(suberror.validator_value == "null" for suberror in branch)
    ]
    return meant[0] if meant else [best_match([error])]


def _explain(error: ValidationError) -> str:
    key = ".".join(str(part) for part in error.absolute_path)
    if error.validator == "additionalProperties":
        known = error.schema["properties"]
        unknown = sorted(set(error.instance) - set(known))
        place = f"'{key}' has" if key else "there are"
        return f"{place} unknown keys {unknown}: remove or correct them (known: {sorted(known)})"
    if error.validator == "required":
        missing = sorted(set(error.validator_value) - set(error.instance))
        return f"'{key}' lacks {missing}: add them"
    description = error.schema.get("description", "")
    wish = f" [{description}]" if description else ""
    return f"'{key}' is {error.instance!r}: {error.message}{_as_number(error)}{wish}"


def _as_number(error: ValidationError) -> str:
    """How to write a number that YAML took for text."""
    if error.validator != "type" or not isinstance(error.instance, str):
        return ""
    try:
        value = float(error.instance.replace(",", "."))
    except ValueError:
        return ""
    if not math.isfinite(value):
        return ""
    if value.is_integer() and error.validator_value == "integer":
        value = int(value)
    # YAML wants a point in what has an exponent
    number = repr(value) if "." in repr(value) else repr(value).replace("e", ".0e")
    return f" but text, as YAML reads it: write {number}"


def _contradictions(config: Mapping) -> list[str]:
    problems = []
    if (config["specimen"] is None) == (config["inputs"] is None):
        problems.append(
            "exactly one of 'specimen' (generated) and 'inputs' (your files) must be there: "
            "set the other to null"
        )
    if config["power"] is not None and config["specimen"] is None:
        problems.append(
            "'power' asks for many generated specimens, and 'specimen' is null: describe the "
            "specimen, or set 'power' to null"
        )
    square = config["square"]
    problems += _frame_problems(square["frame"])
    if config["scans"]["size_mm"] > square["size_mm"]:
        problems.append(
            f"'scans.size_mm' is {config['scans']['size_mm']}, more than the square's "
            f"{square['size_mm']} mm: a patch must fit in the square"
        )
    target = config["macroscale"]["target_pressure_MPa"]
    if config["hardness"] is not None and config["hardness"] <= target:
        problems.append(
            f"'hardness' is {config['hardness']} MPa, not above macroscale.target_pressure_MPa of "
            f"{target}: no contact carries more than its hardness; raise it, or set it to null"
        )
    for name in ("height_quantiles", "gap_limits_um"):
        limits = config["validation"][name]
        if sorted(limits) != list(limits):
            problems.append(f"'validation.{name}' is {limits}: put the limits in rising order")
    short, long = config["texture"]["s_filter_um"], config["texture"]["l_filter_um"]
    if long is not None and long <= short:
        problems.append(
            f"'texture.l_filter_um' is {long}, not above texture.s_filter_um of {short}: no wave "
            "passes both filters; raise it, or set it to null"
        )
    named = {name: config[name] for name in ("patches", "published")}
    for name, path in named.items():
        if path is not None and not Path(path).is_file():
            problems.append(f"'{name}' names {path}, which does not exist: correct the path")
    for name, path in {**named, "square.frame.marker": square["frame"]["marker"]}.items():
        if path is not None and _BRACES & set(path):
            problems.append(
                f"'{name}' names {path}: Snakemake fills in what is in braces; rename the file "
                "or its folder"
            )
    return problems


def _frame_problems(frame: Mapping) -> list[str]:
    """What is wrong with the frame of the square, whichever way it is given."""
    marker, points = frame["marker"], frame["points_mm"]
    if marker is not None and points is not None:
        return ["'square.frame' has both points_mm and marker: set one of them to null"]
    if marker is not None:
        if Path(marker).is_file():
            return []
        return [f"'square.frame.marker' names {marker}, which does not exist: correct the path"]
    if points is not None:
        try:
            frame_from_points(points)
        except ConfigError as error:
            return [str(error)]
        return []
    x_axis, normal = frame["x_axis"], frame["normal"]
    norms = [sum(value * value for value in axis) ** 0.5 for axis in (x_axis, normal)]
    if not all(norms):
        return ["'square.frame' has an axis of length zero: give a direction"]
    if abs(sum(a * b for a, b in zip(x_axis, normal, strict=True))) > 1e-3 * norms[0] * norms[1]:
        return [
            f"'square.frame' has x_axis {x_axis} and normal {normal}, which are not "
            "perpendicular: correct one of them"
        ]
    return []


def study_contact_modulus(material: Mapping) -> float:
    """The contact modulus (MPa) that the study uses: as given, else from the elastic constants."""
    given = material["contact_modulus_MPa"]
    return _standard_contact_modulus(material) if given is None else float(given)


def alternative_contact_modulus(material: Mapping) -> float | None:
    """The standard contact modulus (MPa) where the config gives another one directly, else None."""
    if material["contact_modulus_MPa"] is None:
        return None
    return _standard_contact_modulus(material)


def _standard_contact_modulus(material: Mapping) -> float:
    return contact_modulus(
        material["young_1_MPa"],
        material["poisson_1"],
        material["young_2_MPa"],
        material["poisson_2"],
    )


def study_poisson(material: Mapping) -> float:
    """Poisson's ratio of two like stones as compliant tangentially as the study's two are.

    The mean of both ratios weighted by the stones' shear compliance 1/G = 2 (1 + ν)/E: with it,
    (2 − ν)/(2 (1 − ν)) is the sum of (2 − ν)/(4G) over the sum of (1 − ν)/(2G), tangential over
    normal compliance (Johnson, Contact Mechanics, §7.2).
    """
    # ASSUME: where the two stones differ, their tangential compliances add; that tangential
    # tractions then press unlike bodies apart (Dundurs' β) is neglected.
    ratios = [material["poisson_1"], material["poisson_2"]]
    moduli = [material["young_1_MPa"], material["young_2_MPa"]]
    compliances = [(1 + ratio) / young for ratio, young in zip(ratios, moduli, strict=True)]
    return sum(r * c for r, c in zip(ratios, compliances, strict=True)) / sum(compliances)
