"""A finished study as one zip, for an archive or a paper: a Workflow Run RO-Crate.

The profile (w3id.org/ro/wfrun/workflow/0.5, on RO-Crate 1.1) describes a run as an action: the
workflow, with a config and inputs, made the results. Metadata are a flat list of entities, and are
written here as such: the library rocrate would save ten lines, and dates what it zips. The date of
packing does not enter them: the same results give the same bytes.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote

import yaml

import gst
from gst.chain import is_inside
from gst.provenance import program_hash
from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["pack_study"]

_RO_CRATE = "https://w3id.org/ro/crate/1.1"
_WORKFLOW_CRATE = "https://w3id.org/workflowhub/workflow-ro-crate/1.0"
_PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": "Process Run Crate",
    "https://w3id.org/ro/wfrun/workflow/0.5": "Workflow Run Crate",
    _WORKFLOW_CRATE: "Workflow RO-Crate",
}
_FORMATS = {".md": "text/markdown", ".tsv": "text/tab-separated-values", ".yaml": "text/yaml"}
_FORMATS |= {".csv": "text/csv", ".html": "text/html", ".png": "image/png"}
_FORMATS |= {".json": "application/json"}
_RECORDS = "provenance.json", "contents.json"  # of what a study was made, and what it made
_GENERATED = (
    "The specimen is generated: a program made the stone, its scans and its wear. Nothing here "
    "says anything about a real tool. "
)
_Reference = dict[str, str]


class _Crate:
    """The files of the zip, by their paths in it, and the entities that describe it."""

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        # The entities of the metadata and of the whole come first, and are filled in last.
        self.entities: dict[str, dict[str, Any]] = {"ro-crate-metadata.json": {}, "./": {}}

    def add(self, place: str, kind: str | list[str], /, **properties: Any) -> _Reference:
        """Describe something; an empty list is left out, a list of one value becomes that value."""
        entity = self.entities[place] = {"@id": place, "@type": kind}
        for name, value in properties.items():
            if value != []:
                single = isinstance(value, list) and len(value) == 1
                entity[name] = value[0] if single else value
        return {"@id": place}

    def add_file(
        self, place: str, content: bytes, kind: str | list[str] = "File", /, **properties: Any
    ) -> _Reference:
        self.files[place] = content
        properties["encodingFormat"] = _FORMATS.get(PurePosixPath(place).suffix, "text/plain")
        properties["contentSize"] = str(len(content))
        properties["sha256"] = hashlib.sha256(content).hexdigest()
        return self.add(quote(place), kind, **properties)

    def add_author(self, author: Mapping[str, str]) -> _Reference:
        """A person, or a group if it has a ``name``, as in `CITATION.cff`."""
        kind = "Organization" if "name" in author else "Person"
        name = author.get("name") or f"{author['given-names']} {author['family-names']}"
        return self.add(f"#{quote(name)}", kind, name=name)

    def add_licence(self, name: str) -> _Reference:
        return self.add(f"https://spdx.org/licenses/{quote(name)}", "CreativeWork", name=name)

    def zipped(self) -> bytes:
        context = [f"{_RO_CRATE}/context", {"sha256": "http://schema.org/sha256"}]
        metadata = {"@context": context, "@graph": list(self.entities.values())}
        text = json.dumps(metadata, indent=1, ensure_ascii=False) + "\n"
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w") as archive:
            for place, data in {"ro-crate-metadata.json": text.encode(), **self.files}.items():
                info = zipfile.ZipInfo(place)  # dated 1980
                info.compress_type, info.create_system = zipfile.ZIP_DEFLATED, 3
                info.external_attr = (0o755 if place.endswith("/") else 0o644) << 16
                archive.writestr(info, data, compresslevel=9)
        return content.getvalue()


def pack_study(
    results: str | Path,
    target: str | Path,
    *,
    authors: Iterable[str] = (),
    licence: str | None = None,
) -> int:
    """Pack a finished study: page, tables, figures, config, patch table, workflow and metadata.

    Fields (HDF5), logs and measured inputs are left out; the metadata name them, the inputs with
    their SHA-256. The date of the run is that of its newest result.

    Parameters
    ----------
    results : path
        Folder of the config's key ``results``.
    target : path
        The zip to write.
    authors : iterable of str
        Authors of the study; the workflow has its own.
    licence : str, optional
        Of the results, by its SPDX identifier, such as CC-BY-4.0.

    Returns
    -------
    int
        Number of files in the zip.

    Raises
    ------
    InputError
        `results` has no finished study, a result or an input has changed since, a table of the
        study is missing, or another version of the program made the results.
    OutputError
        `target` cannot be written.
    """
    results, root, crate = Path(results), gst.ROOT, _Crate()
    record, contents = (_read(results / name) for name in _RECORDS)
    config, generated = record["config"], record["config"]["specimen"] is not None
    made = _add_results(crate, results, contents)
    used = _add_inputs(crate, record)
    cff = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    workflow = _add_workflow(crate, root, cff, record["software"])

    people = [crate.add(f"#{quote(name)}", "Person", name=name) for name in authors]
    stone, warning = (
        ("synthetic specimen", _GENERATED) if generated else ("ground stone tool", "")
    )
    packed = {results / entry["file"] for entry in contents} | {results / _RECORDS[0]}
    others = {file for file in results.rglob("[!.]*") if file.is_file()} - packed
    left_out = sorted({file.relative_to(results).parts[0] for file in others})
    about = {
        "name": f"Where a {stone} wears: {config['title']}",
        "description": f"{warning}Results of the study “{config['title']}”, by multi-scale contact "
        "mechanics. Open results/index.html. config/study.yaml is the config as it was run. Left "
        "out, because the workflow can make them again from the inputs: other files of "
        f"{', '.join(left_out)}.",
    }
    readme = f"# {about['name']}\n\n{about['description']}\n"
    crate.add_file("README.md", readme.encode(), about={"@id": "./"})
    newest = max(file.stat().st_mtime for file in packed)
    ended = datetime.fromtimestamp(newest, UTC).replace(microsecond=0).isoformat()
    action = crate.add(
        "#study",
        "CreateAction",
        name=f"The study “{config['title']}”",
        description="It ended when the newest of the packed results was written.",
        instrument=workflow,
        object=used,
        result=made,
        endTime=ended,
        agent=people,
    )
    parts = [*map(quote, crate.files)]
    unlicensed = "None is stated: ask the authors of the results before you use them."
    crate.add(
        "./",
        "Dataset",
        **about,
        datePublished=ended[:10],  # a crate must have one: the day of the results
        license=crate.add_licence(licence) if licence else unlicensed,
        author=people,
        conformsTo=[
            crate.add(profile, "CreativeWork", name=name, version=profile.rpartition("/")[2])
            for profile, name in _PROFILES.items()
        ],
        hasPart=[{"@id": part} for part in parts if part in crate.entities],
        mainEntity=workflow,
        mentions=action,
        citation=crate.entities["Snakefile"]["citation"],
        keywords=cff["keywords"] + ["synthetic specimen"] * generated,
    )
    profiles = [{"@id": _RO_CRATE}, {"@id": _WORKFLOW_CRATE}]
    crate.add(
        "ro-crate-metadata.json", "CreativeWork", about={"@id": "./"}, conformsTo=profiles
    )
    write_whole(target, crate.zipped())
    return 1 + sum(not place.endswith("/") for place in crate.files)


def _add_results(
    crate: _Crate, results: Path, contents: list[dict[str, str]]
) -> list[_Reference]:
    """The page and its contents, as they were when the study ended."""
    from lxml.html import fromstring

    said = {"name": "Provenance", "description": "Config, SHA-256 of every input, versions."}
    record = (results / "provenance.json").read_bytes()
    made = [crate.add_file("results/provenance.json", record, **said)]
    for entry in contents:
        if not is_inside(entry["file"]):
            problem = f"names a file outside the results: {entry['file']}"
            raise InputError(
                results / _RECORDS[1], problem, "Run the study again, then pack it."
            )
        content = _unchanged(results / entry["file"], entry["sha256"])
        said["name"] = f"{entry['category'].partition(' ')[2]}: {entry['title']}"
        said["description"] = " ".join(fromstring(entry["caption"]).text_content().split())
        made.append(crate.add_file(f"results/{entry['file']}", content, **said))
    return made


def _add_inputs(crate: _Crate, record: Mapping[str, Any]) -> list[_Reference]:
    """The config and the study's own tables, as files; measured inputs, by their SHA-256."""
    config = record["config"]
    text = yaml.safe_dump(config, sort_keys=False, allow_unicode=True)
    said = {"name": "The config as it was run", "description": "Defaults included."}
    used = [crate.add_file("config/study.yaml", text.encode(), **said)]
    tables = config["patches"], config["published"], (config["gesture"] or {}).get("table")
    for path, digest in record["inputs"].items():
        content = _unchanged(Path(path), digest) if Path(path).is_file() else None
        if path in tables:
            if content is None:
                remedy = "Pack the study in the folder where it ran."
                raise InputError(path, "this table of the study is missing", remedy)
            inside = not Path(path).is_absolute() and ".." not in Path(path).parts
            place = path if inside else f"inputs/{Path(path).name}"
            said = {"name": path, "description": "A table that the config names."}
            used.append(crate.add_file(place, content, **said))
        else:
            said = {"name": path, "description": "An input, not packed.", "sha256": digest}
            size = [] if content is None else str(len(content))
            used.append(crate.add(f"#{quote(path)}", "CreativeWork", **said, contentSize=size))
    if config["specimen"] is not None:
        said = {
            "name": "Synthetic specimen",
            "description": f"{_GENERATED}The workflow makes it.",
        }
        used.append(crate.add("#specimen", "CreativeWork", **said))
    return used


def _add_workflow(
    crate: _Crate, root: Path, cff: Mapping[str, Any], software: Mapping[str, Any]
) -> _Reference:
    """The workflow, which must be the one that made the results; its requirements; its paper."""
    if software["program"] != program_hash():
        was = f"gstlib {software['gstlib']}, commit {software['commit']}"
        problem = f"another version of the program made the results ({was})"
        raise InputError(
            root, problem, "Run the study again: only steps that have changed are redone."
        )
    whose = {
        "author": [crate.add_author(author) for author in cff["authors"]],
        "license": crate.add_licence(cff["license"]),
    }
    parts = [file for file in sorted((root / "workflow").rglob("[!.]*.*")) if file.is_file()]
    # Among the workflow's parts, not at the root: the results have their own authors and licence.
    files = {f"workflow/{name}": root / name for name in ("CITATION.cff", "LICENSE")}
    files |= {
        file.relative_to(root).as_posix(): file for file in parts if file.suffix != ".pyc"
    }
    crate.files |= {"workflow/": b""} | {
        place: file.read_bytes() for place, file in files.items()
    }
    said = {
        "name": "Parts of the workflow",
        "description": "Rules, scripts, schemas, captions.",
    }
    crate.add("workflow/", "Dataset", **said, **whose)
    said = {"name": "Default config", "description": "Read if no other is given."}
    crate.add_file("config/config.yaml", (root / "config/config.yaml").read_bytes(), **said)
    paper, versions = cff["preferred-citation"], software["packages"]
    return crate.add_file(
        "Snakefile",
        (root / "Snakefile").read_bytes(),
        ["File", "SoftwareSourceCode", "ComputationalWorkflow"],
        name=cff["title"],
        description=cff["abstract"],
        version=f"{software['gstlib']} (commit {software['commit']})"
        if software["commit"]
        else software["gstlib"],
        conformsTo={"@id": "https://bioschemas.org/profiles/ComputationalWorkflow/1.0-RELEASE"},
        programmingLanguage=crate.add(
            "https://w3id.org/workflowhub/workflow-ro-crate#snakemake",
            "ComputerLanguage",
            name="Snakemake",
            url={"@id": "https://snakemake.readthedocs.io"},
            version=versions["snakemake"],
        ),
        softwareRequirements=[f"Python {software['python']}"]
        + [f"{name} {version}" for name, version in versions.items()],
        citation=crate.add(
            f"https://doi.org/{paper['doi']}",
            "ScholarlyArticle",
            name=paper["title"],
            author=[crate.add_author(author) for author in paper["authors"]],
            datePublished=str(paper["year"]),
        ),
        **whose,
    )


def _read(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        problem = "cannot be read: this folder has no finished study"
        raise InputError(file, problem, "Run the study, then pack it.") from error


def _unchanged(file: Path, digest: str) -> bytes:
    """The content of a file, which must be the one that the study recorded."""
    content = file.read_bytes() if file.is_file() else b""
    if hashlib.sha256(content).hexdigest() != digest:
        problem = "is missing, or has changed since the study ended"
        raise InputError(file, problem, "Run the study again, then pack it.")
    return content
