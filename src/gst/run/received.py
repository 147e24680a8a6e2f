"""Files of a results folder, which may come from somebody else.

A results folder is data. Its JSON files are read only in the form that a study writes. A file that
they name is opened only if it is regular and lies where the study may read, after all links are
resolved. Neither a pipe nor a link can therefore stop the program or lead it elsewhere.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from gst import ROOT
from gstlib.errors import InputError
from gstlib.io.files import check_size

__all__ = [
    "OUTPUTS",
    "RECORD",
    "is_readable",
    "places_of",
    "read_json",
    "read_provenance",
    "regular_file",
]

_LARGEST_JSON = 1 << 26  # bytes: digests of half a million files
_DEEPEST = 50  # lists in lists, ten times as many as in a config
_TEXT = {"type": "string"}
_TEXTS = {"type": "array", "items": _TEXT}
_TEXT_OR_NULL = {"type": ["string", "null"]}
_OBJECT_OR_NULL = {"type": ["object", "null"]}
_TEXT_BY_NAME = {"type": "object", "additionalProperties": _TEXT}
# Of a file that was missing there is no digest.
_DIGESTS = {
    "type": "object",
    "additionalProperties": {"type": "string", "minLength": 1},
}


def _form(required: Iterable[str] | None = None, **properties: Any) -> dict[str, Any]:
    """The JSON schema of an object with these properties, all `required` by default, and others."""
    names = [*properties] if required is None else [*required]
    return {"type": "object", "required": names, "properties": properties}


RECORD = _form(
    params=_form(
        ["makes"], makes=_TEXTS, steps=_TEXT_BY_NAME, config=_form([], accept=_TEXTS)
    ),
    inputs=_DIGESTS,
    files=_TEXT_BY_NAME,
    outputs=_DIGESTS,
    messages={"type": "object", "additionalProperties": _TEXTS},
    faults={"type": "object", "additionalProperties": {"type": "boolean"}},
    software=_TEXT_BY_NAME,
)
# What every version of a record has.
OUTPUTS = _form(outputs=_DIGESTS)
_INPUTS = _form(["mesh"], mesh=_TEXT, mesh_unit=_TEXT, scan_folder=_TEXT_OR_NULL)
_CONFIG = {
    "title": _TEXT,
    "patches": _TEXT_OR_NULL,
    "published": _TEXT_OR_NULL,
    "gesture": _form([], table=_TEXT_OR_NULL) | _OBJECT_OR_NULL,
    "inputs": _INPUTS | _OBJECT_OR_NULL,
    "scans": _form(size_mm={"type": "number"}),
}
_SOFTWARE = _form(
    gstlib=_TEXT,
    commit=_TEXT_OR_NULL,
    program=_TEXT,
    python=_TEXT,
    packages=_form(snakemake=_TEXT) | _TEXT_BY_NAME,
)


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
        raise InputError(
            path, problem, "Remove it, or run the study again in its own folder."
        )
    return Path(os.path.realpath(path))


def read_json(path: Path, within: Path, form: Mapping[str, Any]) -> Any:
    """The content of a JSON file in a folder, which has the form of a JSON schema.

    Raises an `InputError` if it cannot be read, or has another form.
    """
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    file = regular_file(path, within)
    check_size(file, _LARGEST_JSON)
    try:
        value = json.loads(file.read_bytes())
        json.dumps(
            value, ensure_ascii=False
        ).encode()  # halves of characters raise an error
        if _depth(value) > _DEEPEST:
            raise ValueError("it is nested too deeply")
        if error := best_match(Draft202012Validator(form).iter_errors(value)):
            raise ValueError(f"{error.json_path}: {error.message}")
    except (ValueError, RecursionError) as error:
        problem = f"is not JSON as a study writes it ({error!s:.200})"
        raise InputError(path, problem, "Run the study again.") from error
    return value


def _depth(value: Any) -> int:
    parts = value.values() if isinstance(value, dict) else value
    return (
        1 + max(map(_depth, parts), default=0) if isinstance(value, dict | list) else 0
    )


def read_provenance(
    results: Path, *keys: str, parts: Sequence[str] = ("config", "inputs", "software")
) -> dict[str, Any]:
    """The provenance of results with these parts, whose config has these keys.

    Raises as `read_json`.
    """
    config = _form(keys, **_CONFIG)
    form = _form(parts, config=config, inputs=_TEXT_BY_NAME, software=_SOFTWARE)
    return read_json(results / "provenance.json", results, form)
