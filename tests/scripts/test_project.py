"""The project's own tools, beside whatever a user keeps in its folder; and its documents."""

import ast
import contextlib
import importlib.metadata
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name

from gst.cli import main

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted(ROOT.glob("docs/**/*.md")),
    ROOT / "config/README.md",
    ROOT / "benchmarks/README.md",
]


def test_a_config_of_the_users_own_makes_no_document_stale(tmp_path):
    for name in ("src", "workflow", "config", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / "README.md", tmp_path)
    (tmp_path / "config/mine.yaml").write_text("title: mine\n")
    command = [sys.executable, "docs/document.py", "--check"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "src")}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True)


def test_the_layout_names_what_there_is():
    """Every room, and the modules that the row of a room names."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    for package in ("gstlib", "gst"):
        table = re.search(
            rf"^## .*`src/{package}`\n(.*?)^## ", text, re.MULTILINE | re.DOTALL
        )[1]
        folder, named = ROOT / "src" / package, set()
        for first, says in re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.MULTILINE):
            rooms, modules = (
                set(re.findall(r"`(\w+[\w./]*)`", cell)) for cell in (first, says)
            )
            named |= rooms
            if len(rooms) == 1 and (folder / min(rooms)).is_dir():
                beside = {file.stem for file in (folder / rooms.pop()).glob("*.py")}
                assert {name for name in modules if "/" not in name} <= beside, first
        there = {file.name for file in folder.glob("[!_]*.py")}
        assert named == there | {
            f"{file.parent.name}/" for file in folder.glob("*/__init__.py")
        }


# What the terms of the field took the place of. "mats" and "ceilings" stand in no compound, either,
# but .mat is a format.
PRIVATE = (
    r"rivals?|foretell\w*|foretold|knows? as much|hardest pressed|wanders?|believed|own_area"
    r"|(active|second|other) stones?|point of force|minded|mats|ceilings?|yielding|pressure_limit"
    r"|hardness_MPa|TipsOver|InvalidContactInput|judge\w*|most_noise|expected_worst|\w+_share"
    r"|loss_per_area_um|loss_depth_um|generated (specimen|stone)s?"
)


def test_terms_are_those_of_the_field():
    places = "src", "workflow", "config", "docs", "README.md"
    command = ["git", "grep", "-nwiE", PRIVATE, "--", *places]
    stated = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout
    assert stated == ""


def links_of(document):
    """The files of the repository to which a document links."""
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)\s]*)?\)", document.read_text("utf-8"))
    return [(document.parent / link).resolve() for link in links if "://" not in link]


@pytest.mark.parametrize(
    "document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix()
)
def test_links_lead_to_files(document):
    assert [link for link in links_of(document) if not link.is_file()] == []


def test_the_index_lists_every_document_once():
    listed = links_of(ROOT / "docs/index.md")[
        1:
    ]  # the first link stands in its first sentence
    assert sorted(listed) == sorted({*DOCUMENTS} - {ROOT / "docs/index.md"})


def test_the_lines_of_readme_print_what_they_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
    )
    stated = re.findall(r"print\(.*\)  # (\S+)", code)
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(code, "README.md", "exec"), {})
    assert len(stated) == 2
    for number, line in zip(stated, printed.getvalue().splitlines(), strict=True):
        assert f" {number} " in line
    assert (tmp_path / "contact.png").is_file()


def texts_of(file):
    """The texts in a module, with … in place of each value that is put in."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.JoinedStr):
            parts = (getattr(part, "value", "…") for part in node.values)
            yield "".join(part if isinstance(part, str) else "…" for part in parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield re.sub(r"%[-+.\d]*[a-z]", "…", node.value).replace("%%", "%")


def test_the_messages_that_are_explained_are_those_of_the_program():
    page = (ROOT / "docs/how-to/troubleshooting.md").read_text("utf-8")
    messages = re.findall(r"^```text\n(.*)\n```$", page, re.MULTILINE)
    modules = [*(ROOT / "src/gst").rglob("*.py"), *(ROOT / "src/gstlib").rglob("*.py")]
    texts = [text for module in modules for text in texts_of(module)]
    assert len(messages) == len(re.findall(r"^### \d+\. ", page, re.MULTILINE)) == 20
    named = [one.replace("TODO", "…") for one in messages]  # by the name of a constant
    assert [one for one in named if not any(one in text for text in texts)] == []


def test_the_worked_example_prints_what_it_says(tmp_path, monkeypatch):
    measured = ROOT.parent / "shared/data/pebble-usewear/confoc_3d.xyz"
    if not measured.is_file():
        pytest.skip(f"no {measured}")
    # the three columns of the file from its source that the example reads
    shutil.copy(measured, tmp_path / "confoc_3d.dat")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/how-to/worked-example.md").read_text("utf-8")
    commands = re.findall(r"^\.\./\.venv/bin/(.*)$", page, re.MULTILINE)
    scripts = iter(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    text = io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
        for command in commands:
            name, *options = shlex.split(command)
            if name == "gst":
                main(options, standalone_mode=False)
            else:
                exec(compile(next(scripts), options[0], "exec"), {})
    printed = text.getvalue()
    stated = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    assert len(commands) == 5
    assert [line for line in "".join(stated).splitlines() if line not in printed] == []
    assert re.search(r"22 +0\.020\d+ |22 +0\.019[5-9]\d+ ", printed)  # 2.0 %
    assert "WARNING: pebble_patch.csv: 36% of the force acts on the outer" in printed


PERMISSIVE = re.compile(
    r"\b(0BSD|Apache|BSD|CC0|ISC|MIT|PSF|Public Domain|Python Software Foundation|Zlib)\b"
)


def is_permissive(package):
    """Whether a package states licences, and a permissive one in each statement."""
    field = (package.get("License") or "").strip()
    classes = [
        text for text in package.get_all("Classifier", []) if text.startswith("License")
    ]
    expression = package.get("License-Expression")
    stated = [expression] if expression else classes or field.splitlines()[:1]
    parts = [part for text in stated for part in re.split(" AND | OR ", text)]
    return bool(parts) and field != "UNKNOWN" and all(map(PERMISSIVE.search, parts))


def test_licences_that_are_not_permissive_are_listed():
    locks = "".join(file.read_text("utf-8") for file in ROOT.glob("*.lock"))
    locked = set(re.findall(r"^([\w.-]+)==", locks, re.MULTILINE))
    page = (ROOT / "docs/how-to/install.md").read_text("utf-8")
    section = re.search(r"^## Licences\n(.*?)^## ", page, re.MULTILINE | re.DOTALL)[1]
    cells = re.findall(r"^\| (`.*?) \|", section, re.MULTILINE)
    listed = set(re.findall(r"`([\w.-]+)`", " ".join(cells)))
    assert listed <= locked
    every = (one.metadata for one in importlib.metadata.distributions())
    packages = {canonicalize_name(about["Name"]): about for about in every}
    installed = locked & packages.keys()
    strict = {name for name in installed if not is_permissive(packages[name])}
    assert strict == listed & installed
