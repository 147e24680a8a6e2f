"""Where a result comes from: hashes of its inputs and of its code, settings and versions."""

import functools
import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import gst
import gstlib
from gstlib.errors import InputError
from gstlib.io.files import sha256

__all__ = [
    "commit",
    "program_hash",
    "provenance",
    "refuse_other_study",
    "refuse_unseen_change",
    "source_hash",
    "study_provenance",
]

# Of the packages that gstlib names, those that a study runs on.
_EXTRAS = "fast", "formats", "texture", "workflow"
# Modules that record a result but do not shape it: a script that imports nothing else of `gst`
# depends on the library alone.
_RECORDING = {"logs", "made", "provenance"}
# Modules that no script imports: the command, and the workflow itself.
_AROUND = {"checking", "cli", "crate", "difference", "epochs", "pick", "running", "shipped"}


def provenance(inputs: Iterable[str | Path], settings: Mapping[str, object]) -> dict[str, str]:
    """Attributes of a result file: hashes of its inputs by name, settings, versions and commit."""
    hashes = {Path(path).name: sha256(path) for path in inputs}
    return {
        "gstlib_version": gstlib.__version__,
        "gstlib_commit": commit(gst.ROOT) or "",
        "packages": json.dumps(_packages()),
        "input_sha256": json.dumps(hashes, sort_keys=True),
        "settings": json.dumps(dict(settings), sort_keys=True, default=str),
    }


def refuse_other_study(config: dict) -> None:
    """Refuse a folder with the results of another study.

    A study may get another title; or its mesh another name, or its scans another folder.

    Raises
    ------
    InputError
    """
    results = Path(config["results"])
    record = results / "provenance.json"
    if not record.is_file():
        return
    with suppress(ValueError):  # half written: the study writes it anew
        written = json.loads(record.read_text(encoding="utf-8"))
        made = written.get("config", config)
        has_other_files = made["inputs"] != config["inputs"]
        if has_other_files and (
            made["title"] != config["title"] or _all_other(written, config)
        ):
            raise InputError(
                results,
                f"holds the results of another study, '{made['title']}', of "
                + (made["inputs"]["mesh"] if made["inputs"] else "a generated stone"),
                "Give `results` another name in the config; if it is the same study, keep its "
                "title, and the name of its mesh or of its folder of scans.",
            )


def _all_other(written: Mapping[str, Any], config: Mapping[str, Any]) -> bool:
    """Whether a study has neither the mesh nor the folder of scans that a record names."""
    made, now = written["config"]["inputs"], config["inputs"]
    if made is None or now is None:
        return True
    if made["mesh"] == now["mesh"] or (now["scan_folder"] or "") == made["scan_folder"]:
        return False
    mesh = Path(now["mesh"])
    return not (mesh.is_file() and sha256(mesh) in written["inputs"].values())


def refuse_unseen_change(results: Path) -> None:
    """Refuse inputs that have changed and kept an earlier date, by which Snakemake judges them.

    Raises
    ------
    InputError
    """
    record = results / "provenance.json"
    with suppress(OSError, ValueError):
        made, dated = json.loads(record.read_text(encoding="utf-8")), record.stat().st_mtime_ns
        for name, digest in made.get("inputs", {}).items():
            file = Path(name)
            is_old = file.is_file() and file.stat().st_mtime_ns < dated
            if is_old and sha256(file) != digest:
                raise InputError(
                    file,
                    "is not the file that the results were made from, but has an earlier date",
                    f"Say that it is new with `touch '{file}'`, and run the study again.",
                )


def study_provenance(
    config: Mapping[str, object], inputs: Iterable[str | Path], commit: str | None, program: str
) -> dict[str, object]:
    """The provenance of all results of a study; the same on every machine.

    `config` is complete, with defaults; `inputs` are the measured files and tables; `commit` and
    `program` (`program_hash`) are those of the program. The result has ``config``; ``inputs``
    (SHA-256 by path); ``software``: gstlib, its commit and hash, Python, and the version of every
    package that gstlib requires.
    """
    return {
        "config": dict(config),
        "inputs": {str(path): sha256(path) for path in sorted(inputs, key=str)},
        "software": {
            "gstlib": gstlib.__version__,
            "commit": commit,
            "program": program,
            "python": platform.python_version(),
            "packages": _packages(),
        },
    }


@functools.cache
def _packages() -> dict[str, str]:
    """Version of every package that gstlib and its workflow require."""
    required = set()
    for text in metadata.requires("gstlib") or []:
        name = re.split(r"[^A-Za-z0-9._-]", text, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"](\w+)", text)
        if name != "gstlib" and (extra is None or extra[1] in _EXTRAS):
            required.add(name)
    return {name: metadata.version(name) for name in sorted(required, key=str.lower)}


@functools.cache
def commit(folder: str | Path) -> str | None:
    """Commit checked out in `folder`, followed by "+" if files differ; None without git."""
    # An installed gstlib may lie in a folder under somebody else's version control.
    if not (Path(folder) / ".git").exists():
        return None
    describe = ["git", "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"]
    try:
        said = subprocess.run(describe, cwd=folder, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return said.stdout.strip()


@functools.cache
def program_hash() -> str:
    """Hash of the library and the workflow; the same for a clone and an installed gstlib."""
    library, application = _hash_of(_folder(gstlib)), _hash_of(_folder(gst), {"shipped"})
    return library + application + _hash_of(gst.ROOT / "workflow")


def source_hash(script: str | Path) -> str:
    """Hash of the code that `script` uses: the library, and `gst` if it does more than record.

    A rule takes this hash as a parameter, so it runs again when that code has changed.
    """
    text = Path(script).read_text(encoding="utf-8")
    imports = set(re.findall(r"\bgst(?:\.| import )(\w+)", text))
    return _package_hash(around=bool(imports - _RECORDING))


@functools.cache
def _package_hash(around: bool) -> str:
    library = _hash_of(_folder(gstlib))
    return library + _hash_of(_folder(gst), _AROUND | _RECORDING) if around else library


def _folder(package: ModuleType) -> Path:
    return Path(str(package.__file__)).parent


def _hash_of(folder: Path, aside: Collection[str] = ()) -> str:
    """Hash of all files in a folder, except parts with these names and Python's caches."""
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.*")):
        name = file.relative_to(folder)
        if "__pycache__" not in name.parts and name.parts[0].split(".")[0] not in aside:
            digest.update(name.as_posix().encode() + file.read_bytes())
    return digest.hexdigest()[:16]
