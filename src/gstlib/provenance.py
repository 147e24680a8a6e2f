"""Where a result comes from: hashes of inputs and of the code that made it, versions, settings."""

import ast
import functools
import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import gstlib

__all__ = ["commit", "file_sha256", "provenance", "source_hash", "study_provenance"]


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal text."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def provenance(inputs: Iterable[str | Path], settings: Mapping[str, object]) -> dict[str, str]:
    """Attributes for a result file: hashes of inputs by name, settings, versions and commit."""
    hashes = {Path(path).name: file_sha256(path) for path in inputs}
    checkout = Path(gstlib.__file__).parents[2]
    # installed elsewhere than in its own checkout, gstlib may lie in somebody else's
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
        Measured files, tables.
    commit : str or None
        Of the program, see `commit`.

    Returns
    -------
    dict
        ``config``; ``inputs`` (SHA-256 by path); ``software``: gstlib with its commit, Python, and
        the version of every package that gstlib asks for.
    """
    return {
        "config": dict(config),
        "inputs": {str(path): file_sha256(path) for path in sorted(inputs, key=str)},
        "software": {
            "gstlib": gstlib.__version__,
            "commit": commit,
            "python": platform.python_version(),
            "packages": _packages(),
        },
    }


def _packages() -> dict[str, str]:
    """Version of every package that gstlib and its workflow ask for."""
    required = {
        re.split(r"[^A-Za-z0-9._-]", text, maxsplit=1)[0]
        for text in metadata.requires("gstlib") or []
        if "extra ==" not in text or "workflow" in text
    }
    return {name: metadata.version(name) for name in sorted(required, key=str.lower)}


@functools.cache
def commit(folder: str | Path) -> str | None:
    """Commit that a folder of the program is at, and "+" if changed since; None without git."""
    try:
        described = subprocess.run(
            [
                "git",
                "-C",
                folder,
                "describe",
                "--always",
                "--abbrev=40",
                "--dirty=+",
                "--exclude=*",
            ],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return described.stdout.strip()


def _imported_names(path: Path, package: Path) -> set[str]:
    """Dotted names that the Python file `path` imports, modules and what is taken from them."""
    inside = path.is_relative_to(package)
    here = path.relative_to(package.parent).parent.parts if inside else ()
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = here[: len(here) - node.level + 1] if node.level else ()
            module = ".".join([*above, *filter(None, [node.module])])
            names.add(module)
            names.update(f"{module}.{alias.name}" for alias in node.names)
    return names


@cache
def _imported_files(path: Path, package: Path, state: tuple[int, int]) -> set[Path]:
    """Files of the package that the Python file `path`, in that state, imports directly."""
    found = set()
    for name in _imported_names(path, package):
        parts = name.split(".")
        if parts[0] != package.name:
            continue
        # importing a module also runs the __init__ of every package above it
        for depth in range(1, len(parts) + 1):
            stem = package.parent.joinpath(*parts[:depth])
            found.update(
                file for file in (stem.with_suffix(".py"), stem / "__init__.py") if file.is_file()
            )
    return found


def source_hash(script: str | Path) -> str:
    """Hash of every gstlib file that `script` imports, however indirectly.

    A rule takes it as a parameter, so that a change in the library reruns just the rules that use
    what changed.
    """
    package = Path(gstlib.__file__).parent
    seen: set[Path] = set()
    queue = {Path(script)}
    while queue:
        file = queue.pop()
        if file not in seen:
            seen.add(file)
            status = file.stat()
            queue |= _imported_files(file, package, (status.st_mtime_ns, status.st_size))
    seen.discard(Path(script))  # Snakemake itself watches the script
    digest = hashlib.sha256()
    for file in sorted(seen):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
