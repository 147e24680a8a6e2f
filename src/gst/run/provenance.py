"""The origin of results: hashes of inputs and code, settings and versions."""

import ast
import functools
import hashlib
import importlib.util
import platform
import subprocess
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from packaging.requirements import Requirement

import gst
import gstlib
from gst.config.tables import read_schema
from gst.run.received import read_provenance
from gstlib.errors import InputError
from gstlib.io.files import sha256

# The extras of gstlib whose packages a study may use.
_EXTRAS = "fast", "formats", "texture", "workflow"
_PROGRAM = "src", "workflow", "Snakefile"
# Of the schema of the tables, the part that shapes a table.
_COLUMNS = "columns"
# Modules that record a result without an effect on it.
_RECORDING = {"gst.run.chain", "gst.run.logs", "gst.run.provenance", "gst.run.received"}


def refuse_other_study(config: Mapping[str, Any]) -> None:
    """Raise an `InputError` if a folder contains the results of another study.

    A study may change its title, the name of its mesh, or the folder of its scans.
    """
    results = Path(config["results"])
    try:
        written = read_provenance(results)
    except (OSError, InputError):
        return  # none, or half written: the study writes it anew
    made = written["config"]
    if not _is_same_study(made, config, written["inputs"].values()):
        stone = made["inputs"]["mesh"] if made["inputs"] else "a synthetic stone"
        raise InputError(
            results,
            f"holds the results of another study, '{made['title']}', of {stone}",
            "Give `results` another name in the config. If it is the same study, keep its title, "
            "and the name of its mesh or of its folder of scans.",
        )


def _is_same_study(
    made: Mapping[str, Any], config: Mapping[str, Any], digests: Iterable[str]
) -> bool:
    """Whether config and results have the same stone; `digests` are SHA-256 of the inputs."""
    before, now = made["inputs"], config["inputs"]
    if before == now:
        return True
    if before is None or now is None or made["title"] != config["title"]:
        return False
    folder = now["scan_folder"] or ""
    if before["mesh"] == now["mesh"] or before.get("scan_folder") == folder:
        return True
    return Path(now["mesh"]).is_file() and sha256(now["mesh"]) in digests


def study_provenance(
    config: Mapping[str, object],
    inputs: Mapping[str, str],
    commit: str | None,
    program: str,
    versions: Mapping[str, str],
) -> dict[str, object]:
    """The provenance of all results of a study; the same on every machine.

    `config` is complete. `inputs` contains the SHA-256 of measured files and tables by path.
    `commit` and `program` (`program_hash`) identify the program. `versions` are the versions with
    which the steps ran (`gst.run.chain.versions_of`).
    """
    packages = {name: version for name, version in versions.items() if name != "python"}
    of_program = {"gstlib": gstlib.__version__, "commit": commit, "program": program}
    software = of_program | {"python": versions.get("python"), "packages": packages}
    return {"config": dict(config), "inputs": dict(inputs), "software": software}


@functools.cache
def software() -> dict[str, str]:
    """Version of Python, and of every package that gstlib and its workflow require."""
    required = set()
    for text in _requirements():
        package = Requirement(text)
        for extra in ("", *_EXTRAS):
            if package.marker is None or package.marker.evaluate({"extra": extra}):
                required.add(package.name)
    names = sorted(required - {"gstlib"}, key=str.lower)
    packages = {name: metadata.version(name) for name in names}
    return {"python": platform.python_version(), **packages}


def _requirements() -> list[str]:
    """The requirements of gstlib, from its installation or, without one, its project file."""
    try:
        return metadata.requires("gstlib") or []
    except metadata.PackageNotFoundError:
        text = (gst.ROOT / "pyproject.toml").read_text("utf-8")
        project = tomllib.loads(text)["project"]
        extras = project["optional-dependencies"]
        return sum((extras[name] for name in _EXTRAS), project["dependencies"])


@functools.cache
def commit(folder: str | Path) -> str | None:
    """Commit checked out in `folder`, with "+" if its program was changed; None without git."""
    # an installed gstlib may be in a folder that is under another version control
    if not (Path(folder) / ".git").exists():
        return None
    # the record itself contains the config and the hashes of the tables
    command = ["git", "status", "--porcelain=v2", "--branch", "--", *_PROGRAM]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    head, *lines = done.stdout.splitlines()
    return head.split()[-1] + "+" * any(not line.startswith("#") for line in lines)


@functools.cache
def program_hash() -> str:
    """Hash of the library and the workflow; the same for a clone and an installed gstlib."""
    folders = _folder(gstlib), _folder(gst), gst.ROOT / "workflow"
    return "".join(
        _hash_of(
            (file.relative_to(folder).as_posix(), file)
            for file in sorted(folder.rglob("[!.]*.*"))
            if not {"__pycache__", "shipped"} & {*file.relative_to(folder).parts}
        )
        for folder in folders
    )


@functools.cache
def source_hash(script: str | Path) -> str:
    """Hash of a script and of every module of this project that it imports.

    This hash is a parameter of the rule, so that the rule runs again when the code changes.
    Comments, docstrings and messages of errors do not change it. A file with the name of a module,
    such as ``page.css`` beside ``page.py``, belongs to the module, except for a stub. The schema of
    the tables belongs to `gst.config.tables`: its columns or, for the page, the whole schema.
    """
    return _hash_of([(Path(script).name, Path(script)), *_parts_of(Path(script))])


@functools.cache
def library_hash(script: str | Path) -> str:
    """Hash of the modules of `gstlib` that a script imports, directly or indirectly."""
    return _hash_of(
        part for part in _parts_of(Path(script)) if part[0].startswith("gstlib")
    )


def _parts_of(script: Path) -> list[tuple[str, Path]]:
    """Name and file of every module of this project that a script imports, in a stable order."""
    modules: dict[str, Path] = {}
    ahead = {*_imported(script, "")}
    while ahead:
        name = ahead.pop()
        if name not in modules and name not in _RECORDING and (file := _source(name)):
            modules[name] = file
            is_package = file.name == "__init__.py"
            ahead |= _imported(file, name if is_package else name.rpartition(".")[0])
    parts = [
        (f"{name} {part.name}", part)
        for name, file in sorted(modules.items())
        for part in _files_beside(file)
    ]
    if "gst.config.tables" in modules:
        is_shown = "gst.page.captions" in modules
        schema = gst.ROOT / "workflow/schemas/tables.yaml"
        parts.append(("captions" if is_shown else _COLUMNS, schema))
    return parts


@functools.cache
def _files_beside(file: Path) -> list[Path]:
    """A module and the files of its name, except for a stub."""
    parts = sorted(file.parent.glob(f"{file.stem}.*"))
    return [part for part in parts if part.suffix != ".pyi"]


@functools.cache
def _imported(file: Path, package: str) -> set[str]:
    """Names of the modules of this project that a file imports, and of their packages."""
    imports, _ = _module(file)
    names = {
        importlib.util.resolve_name(name, package) if name.startswith(".") else name
        for name in imports
    }
    ours = [name.split(".") for name in names if name.startswith("gst")]
    return {".".join(parts[:end]) for parts in ours for end in range(1, len(parts) + 1)}


@functools.cache
def _source(name: str) -> Path | None:
    """The file of a module of this project; None if the name is something else."""
    package, *inside = name.split(".")
    place = _folder(gst if package == "gst" else gstlib).joinpath(*inside)
    files = place / "__init__.py", place.with_suffix(".py")
    return next(filter(Path.is_file, files), None)


def _folder(package: ModuleType) -> Path:
    return Path(str(package.__file__)).parent


def _hash_of(files: Iterable[tuple[str, Path]]) -> str:
    """Hash of files under these names."""
    digest = hashlib.sha256()
    for name, file in files:
        if file.suffix == ".py":
            _, content = _module(file)
        else:
            content = _columns(file) if name == _COLUMNS else file.read_bytes()
        digest.update(name.encode() + content)
    return digest.hexdigest()[:16]


@functools.cache
def _columns(schema: Path) -> bytes:
    """The files of all tables, and their columns with units and digits; no captions or meanings."""
    tables = read_schema(schema).values()
    columns = [
        (table.file, name, column._replace(meaning=""))
        for table in tables
        for name, column in table.columns.items()
    ]
    return repr(columns).encode()


@functools.cache
def _module(file: Path) -> tuple[set[str], bytes]:
    """The names that a module imports, and its lines that can affect a result.

    Docstrings, comments, empty lines and the raising of errors have no effect.
    """
    content = file.read_bytes()
    lines = content.splitlines(keepends=True)
    imports: set[str] = set()
    silent: set[int] = set()
    text: set[int] = set()
    for statement in _statements(ast.parse(content).body):
        span = range(statement.lineno, (statement.end_lineno or 0) + 1)
        match statement:
            case ast.Import(names):
                imports.update(alias.name for alias in names)
            case ast.ImportFrom(module, names, level):
                source = f"{'.' * level}{module or ''}"
                imports.update(f"{source}.{alias.name}" for alias in names)
            case ast.Raise() | ast.Expr(ast.Constant(str())):
                silent.update(span)
            case _ if any(b'"""' in lines[number - 1] for number in span):
                text.update(span)  # in which a # or an empty line need not be a comment
    code = (
        line
        for number, line in enumerate(lines, start=1)
        if number not in silent
        and (number in text or (line.strip() and not line.lstrip().startswith(b"#")))
    )
    return imports, b"".join(code)


def _statements(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """The simple statements of a body and of all bodies in it."""
    for statement in body:
        fields = "body", "orelse", "finalbody", "handlers", "cases"
        inside = [each for field in fields for each in getattr(statement, field, ())]
        yield from _statements(inside) if inside else [statement]
