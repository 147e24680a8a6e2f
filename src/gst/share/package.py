"""A finished study as one zip, for an archive or a paper.

The zip has the page, tables and figures, the records of the steps, the config with its tables, and
the program. The records name the inputs of each file, with their SHA-256. No date goes into the
zip, so that the same results give the same bytes.
"""

import contextlib
import importlib.resources
import io
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gst import ROOT
from gst.config.strict_yaml import as_yaml
from gst.run.chain import (
    PAGE,
    check_chain,
    is_inside,
    made_in,
    read_record,
    record_of,
    steps_in,
)
from gst.run.provenance import program_hash
from gst.run.received import read_provenance, regular_file
from gstlib.errors import InputError
from gstlib.io.files import write_whole

_Files = dict[str, bytes]  # by their names in the zip

# The folders of the results that are packed: the page with its records, and what it shows.
_SHOWN = "", "tables", "figures"
# The page's record of its sources; a zip with this file is a package.
_PROVENANCE = "results/provenance.json"
_PACKAGES = "gst", "gstlib", "snakemake_logger_plugin_gst"
_NOT_PACKED = {"__pycache__", "shipped"}
# Files of the program beside its folders. The results have their own authors and licence, so those
# of the program lie in its folder.
_PROGRAM = {
    "Snakefile": "Snakefile",
    "config/config.yaml": "config/config.yaml",
    "pyproject.toml": "pyproject.toml",
    "requirements.lock": "requirements.lock",
    "requirements-build.lock": "requirements-build.lock",
    "workflow/CITATION.cff": "CITATION.cff",
    "workflow/LICENSE": "LICENSE",
}
_README = """# Where a {stone} wears: {title}

Results of the study “{title}”, by multi-scale contact mechanics. {warning}
Authors: {authors}
Licence of the results: {licence}

Open `results/index.html`. `config/study.yaml` is the config as it was run. The records in
`results/logs` name the files that each step read and made, with their SHA-256. Fields (HDF5) and
logs are left out, because the workflow can make them again from the measured inputs.

The program is in `src`, `workflow` and `profiles`. To make the results again, put the measured
inputs where `config/study.yaml` names them, and run in this folder:

    python3 -m venv .venv
    .venv/bin/python -m pip install --require-hashes -r requirements-build.lock
    .venv/bin/python -m pip install --require-hashes --no-build-isolation -r requirements.lock
    PYTHONPATH=src .venv/bin/python -m gst study config/study.yaml
"""
_GENERATED = (
    "The specimen is generated: a program made the stone, its scans and its wear. These "
    "results do not apply to a real tool.\n"
)
_NO_LICENCE = "none is given. Ask the authors of the results before you use them."


def pack_study(
    results: Path,
    target: Path,
    *,
    authors: Sequence[str] = (),
    licence: str | None = None,
) -> int:
    """Pack a finished study: page, tables, figures, records, config with its tables, program.

    Fields (HDF5), logs and measured inputs are left out. `authors` and `licence` (SPDX, such as
    CC-BY-4.0) are those of the results; the program has its own. The result is the number of files
    in the zip.

    The results may come from somebody else. A file is packed only if its content has the digest
    in the records of the steps, and if it lies in the results or, a table, in the working folder.

    Raises an `InputError` if `results` has no finished study; a file has changed since; a table of
    the study is missing; another version of the program made them; or `target` exists and is no
    package.
    """
    _check_target(target)
    check_chain(results)
    provenance = read_provenance(results)
    config = provenance["config"]
    files = _results(results) | _tables(results, provenance)
    files |= _program(provenance["software"])
    files["config/study.yaml"] = as_yaml(config).encode()
    is_generated = config["specimen"] is not None
    readme = _README.format(
        title=config["title"],
        stone="synthetic specimen" if is_generated else "ground stone tool",
        warning=_GENERATED * is_generated,
        authors=", ".join(authors) or "not given.",
        licence=licence or _NO_LICENCE,
    )
    files["README.md"] = readme.encode()
    write_whole(target, _zipped(files))
    return len(files)


def _check_target(target: Path) -> None:
    """Raise an `InputError` if a file would be replaced that is not an earlier package."""
    if not os.path.lexists(target):
        return
    names: list[str] = []
    with contextlib.suppress(InputError, zipfile.BadZipFile):
        names = zipfile.ZipFile(regular_file(target, target.parent)).namelist()
    if target.is_symlink() or _PROVENANCE not in names:
        problem = "exists, and is not a package of `gst package`"
        raise InputError(
            target, problem, "Remove it, or give another name with --output."
        )


def _results(results: Path) -> _Files:
    """The page, what it shows, and the records of the steps; not the pictures of single patches."""
    files = [record_of(results, step) for step in steps_in(results)]
    for file in made_in(results):
        if file.parent in [results / folder for folder in _SHOWN]:
            files.append(file)
    return {
        f"results/{file.relative_to(results).as_posix()}": (
            regular_file(file, results).read_bytes()
        )
        for file in files
    }


def _tables(results: Path, provenance: Mapping[str, Any]) -> _Files:
    """The tables that the config names, with the contents from which the page was made."""
    config = provenance["config"]
    gesture = config["gesture"] or {}
    tables = config["patches"], config["published"], gesture.get("table")
    named = {str(Path(table)) for table in tables if table is not None}
    digests = (read_record(results, PAGE) or {}).get("files", {})
    files: _Files = {}
    for path in filter(named.__contains__, provenance["inputs"]):
        if not Path(path).exists():
            remedy = "Pack the study in the folder where it ran."
            raise InputError(path, "this table of the study is missing", remedy)
        file = regular_file(path, Path.cwd())
        if path not in digests:  # whose contents `check_chain` compared
            problem = "is not packed, because the page was not made from it"
            raise InputError(path, problem, "Run the study again, then pack it.")
        place = path if is_inside(path) else f"inputs/{Path(path).name}"
        files[place] = file.read_bytes()
    return files


def _program(software: Mapping[str, Any]) -> _Files:
    """The program, which must be the one that made the results."""
    if software["program"] != program_hash():
        problem = (
            "another version of the program made the results: "
            f"{software['gstlib']} (commit {software['commit']})"
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
    return {place: file.read_bytes() for place, file in files.items() if file.is_file()}


def _zipped(files: _Files) -> bytes:
    """A zip of files that are dated 1980, in the order of their names."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in sorted(files):
            info = zipfile.ZipInfo(name)
            info.compress_type, info.create_system = zipfile.ZIP_DEFLATED, 3
            info.external_attr = 0o644 << 16
            archive.writestr(info, files[name], compresslevel=9)
    return content.getvalue()
