"""Files of a results folder, which may come from somebody else.

A results folder is data. Its JSON files are read only in the form that a study writes. A file that
they name is opened only if it is regular and lies where the study may read, after all links are
resolved. Neither a pipe nor a link can therefore stop the program or lead it elsewhere.
"""

import os
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field
from pydantic_core import from_json

from gst import ROOT
from gstlib.errors import InputError
from gstlib.io.files import check_size

_LARGEST_JSON = 1 << 26  # bytes: digests of half a million files
# A missing file has an empty digest, which only measured files may have.
_Digests = dict[str, Annotated[str, Field(min_length=1)]]


class AnyObject(BaseModel):
    """Any JSON object."""


class _Accepting(BaseModel):
    accept: list[str] = []


class _Params(BaseModel):
    makes: list[str]
    steps: dict[str, str] = {}
    config: _Accepting = _Accepting()


class AnyRecord(BaseModel):
    """The part of a step's record that every version has."""

    outputs: _Digests


class StepRecord(AnyRecord):
    """The record of a step."""

    params: _Params
    inputs: _Digests
    files: dict[str, str]
    messages: dict[str, list[str]]
    faults: dict[str, bool]
    software: dict[str, str]


class _Inputs(BaseModel):
    mesh: str
    mesh_unit: str = "mm"
    scan_folder: str | None = None


class _Gesture(BaseModel):
    table: str | None = None


class _Scans(BaseModel):
    size_mm: float


class _Config(BaseModel):
    title: str
    patches: str | None
    published: str | None
    gesture: _Gesture | None
    inputs: _Inputs | None
    scans: _Scans
    specimen: dict[str, Any] | None


class _Software(BaseModel):
    gstlib: str
    commit: str | None
    program: str
    python: str
    packages: dict[str, str]


class _Provenance(BaseModel):
    config: _Config
    inputs: dict[str, str]
    software: _Software


def places_of(named: Any) -> set[Path]:
    """Where a study may read: the working folder, the program, and all that is `named`.

    That is a config, or a list of paths; each text in it may be a path.
    """
    return {Path(os.path.realpath(place)) for place in (".", str(ROOT), *_texts(named))}


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str | Path):
        yield str(value)
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


def is_readable(path: str | Path, places: Set[Path]) -> bool:
    """Whether a path leads to a regular file in or at one of these real places."""
    try:
        real = Path(os.path.realpath(path))
        return not places.isdisjoint([real, *real.parents]) and real.is_file()
    except ValueError:  # a NUL, or half a character
        return False


def regular_file(path: str | Path, within: str | Path) -> Path:
    """The real path of a regular file in a folder; raises an `InputError` if it is not one."""
    if not is_readable(path, {Path(os.path.realpath(within))}):
        problem = f"is not a regular file within the folder {os.path.realpath(within)}"
        remedy = "Remove it, or run the study again in its own folder."
        raise InputError(path, problem, remedy)
    return Path(os.path.realpath(path))


def read_json(path: Path, within: Path, form: type[BaseModel]) -> Any:
    """The content of a JSON file in a folder: an object, which has this form.

    Raises an `InputError` if it cannot be read, or has another form.
    """
    file = regular_file(path, within)
    check_size(file, _LARGEST_JSON)
    try:
        value = from_json(file.read_bytes())
        form.model_validate(value, strict=True)
    except ValueError as error:
        problem = f"is not JSON as a study writes it ({error!s:.200})"
        raise InputError(path, problem, "Run the study again.") from error
    return value


def read_provenance(results: Path) -> dict[str, Any]:
    """The provenance of results. Raises the errors of `read_json`."""
    return read_json(results / "provenance.json", results, _Provenance)
