"""A finished study as one zip, for an archive or a paper: a Workflow Run RO-Crate.

The profile (w3id.org/ro/wfrun/workflow/0.5, on RO-Crate 1.1) describes a run as an action: the
workflow, with a config and inputs, made the results. `crate.yaml`, beside this file, is the
template of that description. The date of packing does not enter it: the same results give the same
bytes.
"""

import hashlib
import importlib.resources
import io
import json
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
from gst.chain import check_chain, is_inside
from gst.provenance import program_hash
from gst.strict_yaml import as_yaml
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
_DEFAULT = "config/config.yaml"
# The program, and what pins the packages that it needs.
_PACKAGES = "gst", "gstlib", "snakemake_logger_plugin_gst"
_PINNED = {
    "pyproject.toml": "What the program needs.",
    "requirements-build.lock": "The packages that install and build others, with their hashes.",
    "requirements.lock": "The packages with which it is tested, with their hashes.",
}
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
    of files in the zip. Raises an `InputError` if `results` has no finished study, a file has
    changed since, a table of the study is missing, or another version of the program made them.
    """
    check_chain(results)
    record, contents = (
        json.loads((results / name).read_text(encoding="utf-8"))
        for name in (_RECORD, _CONTENTS)
    )
    config, software = record["config"], record["software"]
    generated = config["specimen"] is not None
    made, tables = _results(results, contents), _tables(record)
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
    files += [snakefile, *parts, _File("ro-crate-metadata.json", metadata)]
    folders = [_File(f"{name}/", b"") for name in ("profiles", "src", "workflow")]
    write_whole(target, _zipped([*files, *folders]))
    return len(files)


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
    for entry in contents:
        file = entry["file"]
        if not is_inside(file):
            problem = f"names a file outside the results: {file}"
            remedy = "Run the study again, then pack it."
            raise InputError(results / _CONTENTS, problem, remedy)
        title = f"{entry['category'].partition(' ')[2]}: {entry['title']}"
        caption = " ".join(fromstring(entry["caption"]).text_content().split())
        files.append(_File(f"results/{file}", (results / file).read_bytes(), title, caption))
    return files


def _tables(record: Mapping[str, Any]) -> list[_File]:
    """The config and the tables that it names."""
    config = record["config"]
    text = as_yaml(config)
    said = "The config as it was run", "Defaults included."
    files = [_File("config/study.yaml", text.encode(), *said)]
    named = config["patches"], config["published"], (config["gesture"] or {}).get("table")
    for path in record["inputs"]:
        if path in named:
            if not Path(path).is_file():
                remedy = "Pack the study in the folder where it ran."
                raise InputError(path, "this table of the study is missing", remedy)
            place = path if is_inside(path) else f"inputs/{Path(path).name}"
            said = path, "A table that the config names."
            files.append(_File(place, Path(path).read_bytes(), *said))
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
    template = (importlib.resources.files("gst") / "crate.yaml").read_text(encoding="utf-8")
    text = around.from_string(template).render(**said, cff=cff, profiles=_PROFILES)
    entities = yaml.safe_load(text)
    content = {"@context": _CONTEXT, "@graph": entities}
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
