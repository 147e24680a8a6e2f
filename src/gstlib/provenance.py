"""Where a result comes from: hashes of its inputs and of its code, settings and versions."""

import ast
import functools
import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path

import gstlib

__all__ = ["commit", "provenance", "source_hash", "study_provenance"]

# Each function of this module imports what it needs by itself, so only those that are used count.
_BY_FUNCTION = "study.py"

_Code = tuple[Path, str]  # a Python file and the name of a definition in it; "" for all of the file


def provenance(inputs: Iterable[str | Path], settings: Mapping[str, object]) -> dict[str, str]:
    """Attributes of a result file: hashes of its inputs by name, settings, versions and commit."""
    hashes = {Path(path).name: _sha256(path) for path in inputs}
    checkout = Path(gstlib.__file__).parents[2]
    # An installed gstlib may lie in a folder that is under somebody else's version control.
    at = commit(checkout) if (checkout / ".git").exists() else None
    return {
        "gstlib_version": gstlib.__version__,
        "gstlib_commit": at or "",
        "packages": json.dumps(_packages()),
        "input_sha256": json.dumps(hashes, sort_keys=True),
        "settings": json.dumps(dict(settings), sort_keys=True, default=str),
    }


def study_provenance(
    config: Mapping[str, object], inputs: Iterable[str | Path], commit: str | None
) -> dict[str, object]:
    """Where all results of a study come from; the same on every machine.

    Parameters
    ----------
    config : mapping
        The whole configuration, defaults included.
    inputs : iterable of path
        Measured files and tables.
    commit : str or None
        Commit of the program, see `commit`.

    Returns
    -------
    dict
        ``config``; ``inputs`` (SHA-256 by path); ``software``: gstlib with its commit, Python, and
        the version of every package that gstlib requires.
    """
    return {
        "config": dict(config),
        "inputs": {str(path): _sha256(path) for path in sorted(inputs, key=str)},
        "software": {
            "gstlib": gstlib.__version__,
            "commit": commit,
            "python": platform.python_version(),
            "packages": _packages(),
        },
    }


def _sha256(path: str | Path) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@functools.cache
def _packages() -> dict[str, str]:
    """Version of every package that gstlib and its workflow require."""
    required = {
        re.split(r"[^A-Za-z0-9._-]", text, maxsplit=1)[0]
        for text in metadata.requires("gstlib") or []
        if "extra ==" not in text or "workflow" in text
    }
    return {name: metadata.version(name) for name in sorted(required, key=str.lower)}


@functools.cache
def commit(folder: str | Path) -> str | None:
    """Commit checked out in `folder`, followed by "+" if files differ; None without git."""
    describe = ["git", "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"]
    try:
        said = subprocess.run(describe, cwd=folder, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return said.stdout.strip()


def source_hash(script: str | Path) -> str:
    """Hash of the gstlib code that `script` imports, directly or indirectly.

    A rule takes it as a parameter, so that a change in the library reruns only the rules that use
    what changed: files as a whole, of `gstlib.study` only the definitions that are used.
    """
    package = Path(gstlib.__file__).parent
    start = (Path(script), "")
    seen, queue = set(), {start}
    while queue:
        seen.add(code := queue.pop())
        queue |= _used(code, package) - seen
    digest = hashlib.sha256()
    for file, name in sorted(seen - {start}):  # Snakemake itself watches the script
        digest.update(f"{file.relative_to(package).as_posix()} {name}".encode())
        digest.update(ast.dump(_definitions(file)[name]).encode() if name else file.read_bytes())
        # templates and the like, beside a module and named after it
        for data in sorted(set(file.parent.glob(f"{file.stem}.*")) - {file}):
            digest.update(data.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def _definitions(file: Path) -> dict[str, ast.AST]:
    """Functions, classes and constants of a file by name, and the whole of it under ""."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    found: dict[str, ast.AST] = {"": tree}
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [node]
        names = (getattr(target, "name", getattr(target, "id", None)) for target in targets)
        found |= {name: node for name in names if name}
    return found


@functools.cache
def _used(code: _Code, package: Path) -> frozenset[_Code]:
    """The code of the package that `code` uses directly."""
    file, name = code
    found: set[_Code] = set()
    for part in ast.walk(_definitions(file)[name]):
        if name and isinstance(part, ast.Name) and part.id in _definitions(file):
            found.add((file, part.id))
        if not isinstance(part, ast.ImportFrom):
            continue
        folder = file.parents[part.level - 1] if part.level else package.parent
        for alias in part.names:
            # What is imported from a package may be one of its modules; and importing a module
            # also runs the __init__ of every package above it.
            stem = folder.joinpath(*(part.module or "").split("."), alias.name)
            stems = [one for one in (stem, *stem.parents) if one.is_relative_to(package)]
            modules = [m for one in stems for m in (one.with_suffix(".py"), one / "__init__.py")]
            for module in filter(Path.is_file, modules):
                if module != package / _BY_FUNCTION:
                    found.add((module, ""))
                elif alias.name in _definitions(module):
                    found.add((module, alias.name))
    return frozenset(found)
