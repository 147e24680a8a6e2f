"""The project's own tools, beside whatever a user keeps in its folder; and its documents."""

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]


def test_a_config_of_the_users_own_makes_no_document_stale(tmp_path):
    for name in ("src", "workflow", "config", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    (tmp_path / "config/mine.yaml").write_text("title: mine\n")
    command = [sys.executable, "workflow/document.py", "--check"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "src")}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True)


def test_the_lines_of_readme_print_what_they_say(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "README.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(compile(code, "README.md", "exec"), {})
    numbers = re.findall(r"print\(.*\)  # (\S+)", code)
    assert len(numbers) == 2
    for number, line in zip(numbers, capsys.readouterr().out.splitlines(), strict=True):
        assert f" {number} " in line


PERMISSIVE = r"\b(0BSD|Apache|BSD|CC0|ISC|MIT|PSF|Public Domain|Python Software Foundation|Zlib)\b"


def is_permissive(package):
    """Whether a package states licences, and a permissive one in each statement."""
    field = (package.get("License") or "").strip()
    classes = [text for text in package.get_all("Classifier", []) if text.startswith("License")]
    expression = package.get("License-Expression")
    stated = [expression] if expression else classes or field.splitlines()[:1]
    parts = [part for text in stated for part in re.split(" AND | OR ", text)]
    is_each = all(re.search(PERMISSIVE, part) for part in parts)
    return bool(parts) and field != "UNKNOWN" and is_each


def test_licences_that_are_not_permissive_are_listed():
    locks = "".join(file.read_text("utf-8") for file in ROOT.glob("*.lock"))
    locked = set(re.findall(r"^([\w.-]+)==", locks, re.MULTILINE))
    page = (ROOT / "docs/how-to/install.md").read_text("utf-8")
    section = re.search(r"^## Licences\n(.*?)^## ", page, re.MULTILINE | re.DOTALL)[1]
    cells = " ".join(re.findall(r"^\| (`.*?) \|", section, re.MULTILINE))
    listed = set(re.findall(r"`([\w.-]+)`", cells))
    assert listed <= locked
    for distribution in importlib.metadata.distributions():
        about = distribution.metadata
        name = canonicalize_name(about["Name"])
        if name in locked:
            assert is_permissive(about) == (name not in listed), name
