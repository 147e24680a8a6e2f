"""A finished study as one zip, for an archive or a paper: a Workflow Run RO-Crate.

The profile (w3id.org/ro/wfrun/workflow/0.5, on RO-Crate 1.1) describes a run as an action: the
workflow, with a config and inputs, made the results. `crate.yaml`, beside this file, is the
template of that description. The date of packing does not enter it: the same results give the same
bytes.
"""

import contextlib
import hashlib
import importlib.resources
import io
import json
import os
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote

import jinja2
import yaml
from lxml.html import fromstring

from gst import ROOT
from gst.config.strict_yaml import as_yaml
from gst.run.chain import PAGE, check_chain, is_inside, made_in, read_record
from gst.run.provenance import program_hash
from gst.run.received import CONTENTS, read_json, read_provenance, regular_file
from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["pack_study"]

_PROFILES = {
    "Process Run Crate": "https://w3id.org/ro/wfrun/process/0.5",
    "Workflow Run Crate": "https://w3id.org/ro/wfrun/workflow/0.5",
    "Workflow RO-Crate": "https://w3id.org/workflowhub/workflow-ro-crate/1.0",
}
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "http://schema.org/sha256"}]
_FORMATS = {
    ".csv": "text/csv",
    ".html": "text/html",
    ".json": "application/json",
    ".md": "text/markdown",
    ".png": "image/png",
    ".tsv": "text/tab-separated-values",
    ".yaml": "text/yaml",
}
# Of what a study was made, and what it made.
_RECORD, _CONTENTS = "provenance.json", "contents.json"
_IN_CONFIG = "title", "specimen", "patches", "published", "gesture"  # the keys that are read
_METADATA = "ro-crate-metadata.json"
_DEFAULT = "config/config.yaml"
# The program, and what pins the packages that it needs.
_PACKAGES = "gst", "gstlib", "snakemake_logger_plugin_gst"
_PINNED = {
    "pyproject.toml": "What the program needs.",
    "requirements-build.lock": "The packages that install and build others, with their hashes.",
    "requirements.lock": "The packages with which it is tested, with their hashes.",
}
_REMEDY = "Run the study again, then pack it."
_AGAIN = """
The program is in `src`, `workflow` and `profiles`. To make the results again, put the measured
inputs where `config/study.yaml` names them, and run in this folder:

    python3 -m venv .venv
    .venv/bin/python -m pip install --require-hashes -r requirements-build.lock
    .venv/bin/python -m pip install --require-hashes --no-build-isolation -r requirements.lock
    PYTHONPATH=src .venv/bin/python -m gst study config/study.yaml
"""
_GENERATED = (
    "The specimen is generated: a program made the stone, its scans and its wear. Nothing here "
    "says anything about a real tool. "
)


@dataclass(frozen=True)
class _File:
    """A file of the zip, and what is said of it."""

    place: str
    content: bytes
    name: str = ""
    description: str = ""

    @property
    def id(self) -> str:
        return quote(self.place)

    @property
    def format(self) -> str:
        return _FORMATS.get(PurePosixPath(self.place).suffix, "text/plain")

    @property
    def sha256(self) -> str:
        return hashlib.sha256(self.content).hexdigest()


def pack_study(
    results: Path, target: Path, *, authors: Iterable[str] = (), licence: str | None = None
) -> int:
    """Pack a finished study: page, tables, figures, config, patch table, program and metadata.

    Fields (HDF5), logs and measured inputs are left out; the metadata name them, the inputs with
    their SHA-256. The date of the run is that of its newest result. `authors` and `licence` (SPDX,
    such as CC-BY-4.0) are those of the results; the workflow has its own. The result is the number
    of files in the zip.

    The results may come from somebody else. A file is packed only if its content has the digest
    in the records of the steps, and if it lies in the results or, a table, in the working folder.

    Raises an `InputError` if `results` has no finished study, a file has changed since, or names
    another file; a table of the study is missing; another version of the program made them; or
    `target` exists and is no package.
    """
    _check_target(target)
    check_chain(results)
    record = read_provenance(results, *_IN_CONFIG)
    contents = read_json(results / _CONTENTS, results, CONTENTS)
    config, software = record["config"], record["software"]
    generated = config["specimen"] is not None
    made, tables = _results(results, contents), _tables(results, record)
    snakefile, *parts = _workflow(software)
    about = _about(config)
    readme = f"# {about['name']}\n\n{about['description']}\n{_AGAIN}"
    default = (ROOT / _DEFAULT).read_bytes()
    files = [
        *made,
        *tables,
        _File(_DEFAULT, default, "Default config", "Read if no other is given."),
        _File("README.md", readme.encode(), "Read me", "What is in this folder."),
    ]
    for name, said in _PINNED.items():
        if (ROOT / name).is_file():  # of a clone
            files.append(_File(name, (ROOT / name).read_bytes(), name, said))
    named = [file.name for file in tables]
    inputs = {path: digest for path, digest in record["inputs"].items() if path not in named}
    used = [file.id for file in tables] + [f"#{quote(path)}" for path in inputs]
    metadata = _metadata(
        **about,
        title=config["title"],
        generated=generated,
        ended=_ended(results, contents),
        authors=[_author({"name": name}, "Person") for name in authors],
        licence=licence,
        software=software,
        version=_version(software),
        snakefile=snakefile,
        files=files,
        inputs=inputs,
        made=[file.id for file in made],
        used=used + ["#specimen"] * generated,
    )
    files += [snakefile, *parts, _File(_METADATA, metadata)]
    folders = [_File(f"{name}/", b"") for name in ("profiles", "src", "workflow")]
    write_whole(target, _zipped([*files, *folders]))
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
        raise InputError(target, problem, "Remove it, or give another name with --output.")


def _about(config: Mapping[str, Any]) -> dict[str, str]:
    """Name and description of the whole."""
    stone, warning = "ground stone tool", ""
    if config["specimen"] is not None:
        stone, warning = "synthetic specimen", _GENERATED
    return {
        "name": f"Where a {stone} wears: {config['title']}",
        "description": f"{warning}Results of the study “{config['title']}”, by multi-scale contact "
        "mechanics. Open results/index.html. config/study.yaml is the config as it was run. Left "
        "out, because the workflow can make them again from the inputs, are logs and all fields "
        "(HDF5).",
    }


def _ended(results: Path, contents: Iterable[Mapping[str, str]]) -> str:
    """When the newest of the results was written."""
    files = [results / _RECORD, *(results / entry["file"] for entry in contents)]
    newest = max(file.stat().st_mtime for file in files)
    return datetime.fromtimestamp(newest, UTC).replace(microsecond=0).isoformat()


def _results(results: Path, contents: Iterable[Mapping[str, str]]) -> list[_File]:
    """The page and its contents, with their captions, and the record."""
    said = "Provenance", "Config, SHA-256 of every input, versions."
    files = [_File(f"results/{_RECORD}", (results / _RECORD).read_bytes(), *said)]
    made = {*made_in(results)}
    for entry in contents:
        file = entry["file"]
        if not is_inside(file):
            problem = f"names a file outside the results: {file}"
            raise InputError(results / _CONTENTS, problem, _REMEDY)
        if results / file not in made:
            problem = f"names a file that no step made, or names it twice: {file}"
            raise InputError(results / _CONTENTS, problem, _REMEDY)
        made.remove(results / file)
        content = regular_file(results / file, results).read_bytes()
        title = f"{entry['category'].partition(' ')[2]}: {entry['title']}"
        files.append(_File(f"results/{file}", content, title, _as_text(entry["caption"])))
    return files


def _as_text(caption: str) -> str:
    """A caption without its markup."""
    return " ".join(fromstring(f"<div>{caption}</div>").text_content().split())


def _tables(results: Path, record: Mapping[str, Any]) -> list[_File]:
    """The config and the tables that it names."""
    config = record["config"]
    text = as_yaml(config)
    said = "The config as it was run", "Defaults included."
    files = [_File("config/study.yaml", text.encode(), *said)]
    tables = config["patches"], config["published"], (config["gesture"] or {}).get("table")
    named = {str(Path(table)) for table in tables if table is not None}
    digests = (read_record(results, PAGE) or {}).get("files", {})
    for path in record["inputs"]:
        if path in named:
            if not Path(path).exists():
                remedy = "Pack the study in the folder where it ran."
                raise InputError(path, "this table of the study is missing", remedy)
            place = path if is_inside(path) else f"inputs/{Path(path).name}"
            said = path, "A table that the config names."
            file = _File(place, regular_file(path, Path.cwd()).read_bytes(), *said)
            if file.sha256 != digests.get(path):
                problem = "is not packed, because the page was not made from this content"
                raise InputError(path, problem, _REMEDY)
            files.append(file)
    return files


def _workflow(software: Mapping[str, Any]) -> list[_File]:
    """The workflow, which must be the one that made the results, the Snakefile first."""
    if software["program"] != program_hash():
        problem = f"another version of the program made the results: {_version(software)}"
        remedy = "Run the study again: only steps that have changed are redone."
        raise InputError(ROOT, problem, remedy)
    # The results have their own authors and licence, so those of the workflow are not at the root.
    places = {"Snakefile": "Snakefile", "CITATION.cff": "workflow/CITATION.cff"}
    places["LICENSE"] = "workflow/LICENSE"
    files = {place: ROOT / name for name, place in places.items()}
    parts = {"workflow": ROOT / "workflow", "profiles/default": ROOT / "profiles/default"}
    for name in _PACKAGES:
        parts[f"src/{name}"] = Path(str(importlib.resources.files(name)))
    for place, folder in parts.items():
        for file in sorted(folder.rglob("[!.]*")):
            within = file.relative_to(folder)
            if file.is_file() and not {"__pycache__", "shipped"} & {*within.parts}:
                files[f"{place}/{within.as_posix()}"] = file
    return [_File(place, file.read_bytes()) for place, file in files.items()]


def _version(software: Mapping[str, Any]) -> str:
    commit = software["commit"]
    return software["gstlib"] + (f" (commit {commit})" if commit else "")


def _author(author: Mapping[str, str], named: str = "Organization") -> dict[str, str]:
    """An author as in `CITATION.cff`; one with a ``name`` alone is `named` a group, or a person."""
    kind = named if "name" in author else "Person"
    name = author.get("name") or f"{author['given-names']} {author['family-names']}"
    return {"id": f"#{quote(name)}", "kind": kind, "name": name}


def _metadata(**said: Any) -> bytes:
    """The description of the package, from its template."""
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    for work in (cff, cff["preferred-citation"]):
        work["authors"] = [_author(author) for author in work["authors"]]
    around = jinja2.Environment(
        trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    template = (importlib.resources.files("gst.share") / "crate.yaml").read_text(
        encoding="utf-8"
    )
    text = around.from_string(template).render(**said, cff=cff, profiles=_PROFILES)
    entities = yaml.safe_load(text)
    # through JSON once more, which puts the two halves of a character together
    content = json.loads(json.dumps({"@context": _CONTEXT, "@graph": entities}))
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def _zipped(files: Iterable[_File]) -> bytes:
    """A zip of files that are dated 1980, and in the order of their names."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for file in sorted(files, key=lambda file: file.place):
            info = zipfile.ZipInfo(file.place)
            info.compress_type, info.create_system = zipfile.ZIP_DEFLATED, 3
            info.external_attr = (0o755 if info.is_dir() else 0o644) << 16
            archive.writestr(info, file.content, compresslevel=9)
    return content.getvalue()
