"""The project's own tools, in any order, and beside whatever a user keeps in its folder."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_folders_of_tests_are_collected_together():
    folders = "tests/workflow/test_mesh_only.py", "tests/library/io", "tests/library/bem"
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", *folders]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_config_of_the_users_own_makes_no_document_stale(tmp_path):
    for name in ("src", "workflow", "config", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / "README.md", tmp_path)
    (tmp_path / "config/mine.yaml").write_text("title: mine\n")
    command = [sys.executable, "workflow/document.py", "--check"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "src")}
    result = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


def test_the_layout_names_what_there_is():
    """All of `gst`; of the library every room, and the modules that the row of a room names."""
    text = (ROOT / "docs/layout.md").read_text("utf-8")
    for package in ("gstlib", "gst"):
        table = re.search(rf"^## .*`src/{package}`\n(.*?)^## ", text, re.MULTILINE | re.DOTALL)[1]
        folder, named = ROOT / "src" / package, set()
        for first, says in re.findall(r"^\| (`.*?) \| (.*?) \|", table, re.MULTILINE):
            rooms, modules = (set(re.findall(r"`(\w+[\w./]*)`", cell)) for cell in (first, says))
            named |= rooms
            if package == "gstlib" and len(rooms) == 1:
                beside = {file.stem for file in (folder / rooms.pop()).glob("*.py")}
                assert {name for name in modules if "/" not in name} <= beside, first
        there = {file.name for file in folder.glob("[!_]*.py")}
        assert named == there | {f"{file.parent.name}/" for file in folder.glob("*/__init__.py")}


# What the terms of the field took the place of. "mats" and "ceilings" stand in no compound, either.
PRIVATE = (
    r"rivals?|foretell\w*|foretold|knows? as much|hardest pressed|wanders?|believed|own_area"
    r"|(active|second|other) stones?|point of force|minded|mats?|ceilings?|yielding|pressure_limit"
    r"|hardness_MPa|TipsOver|InvalidContactInput|judge\w*|most_noise|expected_worst|\w+_share"
    r"|loss_per_area_um|loss_depth_um|generated (specimen|stone)s?"
)


def test_terms_are_those_of_the_field():
    places = "src", "workflow", "config", "docs", "README.md"
    command = ["git", "grep", "-nwiE", PRIVATE, "--", *places]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    assert said == ""
