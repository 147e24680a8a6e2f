"""The files that a config names: whether they are there, and not where the results go."""

import difflib
import os
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from gst.config.patches import at_epoch, scan_files
from gstlib.errors import ConfigError


def check_files(config: Mapping, patches: pd.DataFrame, source: str) -> None:
    """Raise a `ConfigError` that lists measured files that are missing, or of unusable names.

    `config` is whole and has ``inputs``; `patches` is its patch table; `source` names both.
    """
    files = {"mesh": config["inputs"]["mesh"]} | _of_active_tool(config)
    for scan in scan_files(patches, config["inputs"]["scan_folder"] or "", None):
        files[at_epoch(scan.patch, scan.epoch)] = str(scan.path)
    problems = [
        f"\n  - {name}: {problem}"
        for name, path in files.items()
        if (problem := path_problem(path))
    ]
    if problems:
        problem = f"{len(problems)} of {len(files)} files cannot be used{''.join(problems)}\n "
        remedy = "Put them there, or correct their names. Paths are relative to the working folder."
        raise ConfigError(source, problem, remedy)


def path_problem(path: str) -> str | None:
    """The problem with the path of a file, if there is one."""
    if set("{}") & set(path):
        return f"{path} contains braces, which Snakemake reads as a placeholder"
    if "\0" in path:
        return f"{path!r} contains a NUL, which no name of a file can have"
    if Path(path).is_file():
        return None
    if Path(path).is_dir():
        return f"{path} is a folder, and not a file"
    if Path(path).exists():
        return f"{path} is a pipe or a device, and not a file"
    folder = Path(path).parent
    there = [file.name for file in folder.iterdir()] if folder.is_dir() else []
    near = difflib.get_close_matches(Path(path).name, there, n=1)
    return f"{path} does not exist" + "".join(
        f" (did you mean {name}?)" for name in near
    )


def input_in_results(config: Mapping) -> str | None:
    """An input of the study, or the working folder, that lies in the folder of the results."""
    inputs = config["inputs"] or {}
    files = {
        "working folder": ".",
        "patch table": config["patches"],
        "published figures": config["published"],
        "mesh": inputs.get("mesh"),
        "scans": inputs.get("scan_folder"),
        "poses": (config["gesture"] or {}).get("table"),
    }
    folder = os.path.realpath(config["results"])
    for name, file in (files | _of_active_tool(config)).items():
        if file is not None and Path(os.path.realpath(file)).is_relative_to(folder):
            return f"the {name} ({file})"
    return None


def _of_active_tool(config: Mapping) -> dict[str, str]:
    """Mesh and scan of the active tool, as far as they are given, by their kind."""
    tool = config["counterface"] or {}
    return {
        f"counterface's {name}": tool[name] for name in ("mesh", "scan") if name in tool
    }
