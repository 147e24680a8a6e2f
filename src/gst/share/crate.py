"""A finished study as one zip, for an archive or a paper.

The zip has the page, tables and figures, the records of the steps, the config with its tables, and
the program. The records name the inputs of each file. A small ``ro-crate-metadata.json`` names the
files, as RO-Crate 1.1 asks (w3id.org/ro/crate/1.1). The date of packing is left out, so that the
same results give the same bytes.
"""

import contextlib
import hashlib
import importlib.resources
import io
import json
import os
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from gst import ROOT
from gst.config.strict_yaml import as_yaml
from gst.run.chain import (
    LOGS,
    PAGE,
    check_chain,
    is_inside,
    made_in,
    read_record,
    steps_in,
)
from gst.run.provenance import program_hash
from gst.run.received import CONTENTS, read_json, read_provenance, regular_file
from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["pack_study"]

_PROVENANCE, _CONTENTS, _METADATA = (
    "provenance.json",
    "contents.json",
    "ro-crate-metadata.json",
)
_IN_CONFIG = (
    "title",
    "specimen",
    "patches",
    "published",
    "gesture",
)  # the keys that are read
_FORMATS = {
    ".csv": "text/csv",
    ".html": "text/html",
    ".json": "application/json",
    ".md": "text/markdown",
    ".png": "image/png",
    ".tsv": "text/tab-separated-values",
    ".yaml": "text/yaml",
}
_PACKAGES = "gst", "gstlib", "snakemake_logger_plugin_gst"
_NOT_PACKED = {"__pycache__", "shipped"}
# Files of the program beside its folders.
_PROGRAM = {
    name: name
    for name in (
        "Snakefile",
        "config/config.yaml",
        "pyproject.toml",
        "requirements.lock",
        "requirements-build.lock",
    )
}
# The results have their own authors and licence, so those of the program lie in its folder.
_PROGRAM |= {f"workflow/{name}": name for name in ("CITATION.cff", "LICENSE")}
_REMEDY = "Run the study again, then pack it."
_README = """# {name}

{description}

The program is in `src`, `workflow` and `profiles`. To make the results again, put the measured
inputs where `config/study.yaml` names them, and run in this folder:

    python3 -m venv .venv
    .venv/bin/python -m pip install --require-hashes -r requirements-build.lock
    .venv/bin/python -m pip install --require-hashes --no-build-isolation -r requirements.lock
    PYTHONPATH=src .venv/bin/python -m gst study config/study.yaml
"""
_DESCRIPTION = (
    "Results of the study “{title}”, by multi-scale contact mechanics. Open results/index.html. "
    "config/study.yaml is the config as it was run. Left out, because the workflow can make them "
    "again from the inputs, are logs and all fields (HDF5)."
)
_GENERATED = (
    "The specimen is generated: a program made the stone, its scans and its wear. These "
    "results do not apply to a real tool. "
)
_NO_LICENCE = "No licence is given. Ask the authors of the results before you use them."


class _File(NamedTuple):
    """A file of the zip, and its name in the metadata, which leave out a file without one."""

    place: str
    content: bytes
    name: str = ""

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()


def pack_study(
    results: Path,
    target: Path,
    *,
    authors: Sequence[str] = (),
    licence: str | None = None,
) -> int:
    """Pack a finished study: page, tables, figures, records, config with its tables, program.

    Fields (HDF5), logs and measured inputs are left out; the provenance names the inputs with their
    SHA-256. The crate has the date of its newest result. `authors` and `licence` (SPDX, such as
    CC-BY-4.0) are those of the results; the program has its own. The result is the number of files
    in the zip.

    The results may come from somebody else. A file is packed only if its content has the digest
    in the records of the steps, and if it lies in the results or, a table, in the working folder.

    Raises an `InputError` if `results` has no finished study, a file has changed since, or names
    another file; a table of the study is missing; another version of the program made them; or
    `target` exists and is no package.
    """
    _check_target(target)
    check_chain(results)
    provenance = read_provenance(results, *_IN_CONFIG)
    contents = read_json(results / _CONTENTS, results, CONTENTS)
    config, files = provenance["config"], _results(results, contents)
    dates = [os.path.getmtime(results / file.place.partition("/")[2]) for file in files]
    newest = datetime.fromtimestamp(max(dates), UTC)
    stone, warning = "ground stone tool", ""
    if config["specimen"] is not None:
        stone, warning = "synthetic specimen", _GENERATED
    about = {
        "name": f"Where a {stone} wears: {config['title']}",
        "description": warning + _DESCRIPTION.format(title=config["title"]),
        "keywords": ["wear", "contact mechanics", stone],
        "datePublished": newest.date().isoformat(),
        "license": f"https://spdx.org/licenses/{licence}" if licence else _NO_LICENCE,
    }
    files += _tables(results, provenance)
    files.append(_File("README.md", _README.format(**about).encode(), "Read me"))
    files += [*_records(results), *_program(provenance["software"])]
    files.append(_File(_METADATA, _metadata(about, files, authors)))
    write_whole(target, _zipped(files))
    return len(files)


def _check_target(target: Path) -> None:
    """Raise an `InputError` if a file would be replaced that is not an earlier package."""
    if not os.path.lexists(target):
        return
    names: list[str] = []
    with contextlib.suppress(InputError, zipfile.BadZipFile):
        names = zipfile.ZipFile(regular_file(target, target.parent)).namelist()
    if target.is_symlink() or _METADATA not in names:
        problem = "exists, and is not a package of `gst package`"
        raise InputError(
            target, problem, "Remove it, or give another name with --output."
        )


def _results(results: Path, contents: Iterable[Mapping[str, str]]) -> list[_File]:
    """The page and its contents, with the provenance."""
    files = [
        _File(
            f"results/{name}", regular_file(results / name, results).read_bytes(), title
        )
        for name, title in ((_PROVENANCE, "Provenance"), (_CONTENTS, "Captions"))
    ]
    made = {*made_in(results)} - {results / _PROVENANCE, results / _CONTENTS}
    for entry in contents:
        name, problem = entry["file"], None
        file = results / name
        if not is_inside(name):
            problem = f"names a file outside the results: {name}"
        elif file not in made:
            problem = f"names a file that no step made, or names it twice: {name}"
        if problem:
            raise InputError(results / _CONTENTS, problem, _REMEDY)
        made.remove(file)
        _, _, category = entry["category"].partition(" ")
        title = f"{category}: {entry['title']}"
        files.append(
            _File(f"results/{name}", regular_file(file, results).read_bytes(), title)
        )
    return files


def _records(results: Path) -> list[_File]:
    """The records of the steps, from which the provenance was derived."""
    steps = steps_in(results)
    return [
        _File(f"results/{LOGS}/{file.name}", regular_file(file, results).read_bytes())
        for file in results.glob(f"{LOGS}/*.json")
        if file.stem in steps
    ]


def _tables(results: Path, provenance: Mapping[str, Any]) -> list[_File]:
    """The config and the tables that it names."""
    config = provenance["config"]
    files = [
        _File("config/study.yaml", as_yaml(config).encode(), "The config as it was run")
    ]
    gesture = config["gesture"] or {}
    tables = config["patches"], config["published"], gesture.get("table")
    named = {str(Path(table)) for table in tables if table is not None}
    digests = (read_record(results, PAGE) or {}).get("files", {})
    for path in filter(named.__contains__, provenance["inputs"]):
        if not Path(path).exists():
            remedy = "Pack the study in the folder where it ran."
            raise InputError(path, "this table of the study is missing", remedy)
        place = path if is_inside(path) else f"inputs/{Path(path).name}"
        file = _File(place, regular_file(path, Path.cwd()).read_bytes(), path)
        if file.sha256 != digests.get(path):
            problem = "is not packed, because the page was not made from this content"
            raise InputError(path, problem, _REMEDY)
        files.append(file)
    return files


def _program(software: Mapping[str, Any]) -> list[_File]:
    """The program, which must be the one that made the results."""
    if software["program"] != program_hash():
        problem = (
            f"another version of the program made the results: {_version(software)}"
        )
        remedy = "Run the study again: only steps that have changed are redone."
        raise InputError(ROOT, problem, remedy)
    files = {place: ROOT / name for place, name in _PROGRAM.items()}
    folders = {place: ROOT / place for place in ("workflow", "profiles/default")}
    for name in _PACKAGES:
        folders[f"src/{name}"] = Path(str(importlib.resources.files(name)))
    for place, folder in folders.items():
        for file in folder.rglob("[!.]*"):
            within = file.relative_to(folder)
            if _NOT_PACKED.isdisjoint(within.parts):
                files[f"{place}/{within.as_posix()}"] = file
    # an installed program lies without its lock files
    return [
        _File(place, file.read_bytes())
        for place, file in files.items()
        if file.is_file()
    ]


def _version(software: Mapping[str, Any]) -> str:
    commit = software["commit"]
    return software["gstlib"] + (f" (commit {commit})" if commit else "")


def _metadata(
    about: Mapping[str, Any], files: Iterable[_File], authors: Iterable[str]
) -> bytes:
    """The whole and its named files, as RO-Crate describes them."""
    people = [
        {"@id": f"#{quote(each)}", "@type": "Person", "name": each} for each in authors
    ]
    described = [
        {
            "@id": quote(file.place),
            "@type": "File",
            "name": file.name,
            "encodingFormat": _FORMATS.get(Path(file.place).suffix, "text/plain"),
            "contentSize": str(len(file.content)),
            "sha256": file.sha256,
        }
        for file in files
        if file.name
    ]
    whole = {"@id": "./", "@type": "Dataset", **about}
    for name, entities in (("author", people), ("hasPart", described)):
        if entities:
            whole[name] = [{"@id": entity["@id"]} for entity in entities]
    descriptor = {
        "@id": _METADATA,
        "@type": "CreativeWork",
        "about": {"@id": "./"},
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
    }
    context = [
        "https://w3id.org/ro/crate/1.1/context",
        {"sha256": "http://schema.org/sha256"},
    ]
    graph = {"@context": context, "@graph": [descriptor, whole, *described, *people]}
    return (json.dumps(graph, indent=1, ensure_ascii=False) + "\n").encode()


def _zipped(files: Iterable[_File]) -> bytes:
    """A zip of files that are dated 1980, and in the order of their names."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for file in sorted(files):
            info = zipfile.ZipInfo(file.place)
            info.compress_type, info.create_system = zipfile.ZIP_DEFLATED, 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, file.content, compresslevel=9)
    return content.getvalue()
