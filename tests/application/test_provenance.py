"""Provenance does not depend on the machine; source hashes follow the library."""

import json
import platform
import shutil
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest
from folders import fill

import gst
import gstlib
from gst.config.reading import complete
from gst.run import provenance
from gst.run.provenance import (
    commit,
    refuse_other_study,
    software,
    source_hash,
    study_provenance,
)
from gstlib.errors import InputError
from gstlib.io.files import sha256

SCRIPTS = gst.ROOT / "workflow/scripts"


def test_provenance_has_the_versions_on_which_the_steps_ran():
    written = study_provenance({}, {}, None, "", software())["software"]
    assert written["python"] == platform.python_version()
    assert {"numpy", "scipy", "snakemake"} <= written["packages"].keys()


def test_a_commit_is_told_with_a_change_of_its_program(tmp_path):
    def git(*arguments):
        as_me = ["-c", "user.name=me", "-c", "user.email=me@here"]
        subprocess.check_output(["git", "-C", tmp_path, *as_me, *arguments])

    git("init")
    (tmp_path / "Snakefile").write_text("a")
    git("add", ".")
    git("commit", "-m", "first")
    clean = commit(tmp_path)
    assert len(clean) == 40
    (tmp_path / "Snakefile").write_text("b")
    commit.cache_clear()
    assert commit(tmp_path) == f"{clean}+"


STEPS = "solve_patches", "tabulate_texture", "draw_figures", "write_page"


def forget_files():
    for function in vars(provenance).values():
        if hasattr(function, "cache_clear"):
            function.cache_clear()


def hashes():
    forget_files()
    return {name: source_hash(SCRIPTS / f"{name}.py") for name in STEPS}


SCHEMA = "workflow/schemas/tables.yaml"
X = "x = 0\n"
TABLE = """
extra:
  title: title
  stage: wear
  key: [x_mm]
  caption: caption
  columns:
    x_mm: {unit: mm, meaning: meaning}
"""
# An addition to a file of the program, and the steps whose hashes it changes.
ADDED = [
    ("gst/page/page.css", X, {"write_page"}),
    ("gst/run/chain.py", X, set()),
    ("gstlib/change/texture.py", X, {"tabulate_texture"}),
    ("gstlib/surfaces/grid.py", X, set(STEPS)),
    ("gstlib/__init__.pyi", X, set()),
    (SCHEMA, TABLE, {"tabulate_texture", "draw_figures", "write_page"}),
    (SCHEMA, TABLE.replace("meaning: meaning", "meaning: another"), {"write_page"}),
]


def test_the_hash_of_a_step_moves_with_the_modules_that_it_runs_on(
    tmp_path, monkeypatch
):
    before = hashes()
    for package in (gst, gstlib):
        copy = tmp_path / package.__name__
        shutil.copytree(
            Path(package.__file__).parent, copy, ignore=lambda *_: ["__pycache__"]
        )
        monkeypatch.setattr(package, "__file__", str(copy / "__init__.py"))
    (tmp_path / SCHEMA).parent.mkdir(parents=True)
    shutil.copy(gst.ROOT / SCHEMA, tmp_path / SCHEMA)
    monkeypatch.setattr(gst, "ROOT", tmp_path)
    assert hashes() == before
    for name, addition, steps in ADDED:
        with (tmp_path / name).open("a") as file:
            file.write(addition)
        after = hashes()
        assert {step for step in STEPS if after[step] != before[step]} == steps, name
        before = after
    forget_files()


CODE = '''"""Words."""
import os
x = """
# a
"""
if x:
    raise ValueError("a")
'''


@pytest.mark.parametrize(
    ("old", "new", "is_the_same"),
    [
        ('"""Words."""', '"""Other words.\n\nMore."""', True),
        ("import os\n", "import os\n\n# why\n", True),
        ('ValueError("a")', 'ValueError(\n        "b"\n    )', True),
        ("# a\n", "# b\n", False),
        ("# a\n", "\n# a\n", False),
        ("import os\n", "", False),
        ("if x:", "if not x:", False),
        ("import os\n", "import os\n...\n", False),
    ],
)
def test_only_code_that_shapes_a_result_makes_a_step_run_again(
    tmp_path, old, new, is_the_same
):
    """Docstrings, comments and messages of errors do not."""
    file, other = tmp_path / "a.py", tmp_path / "b.py"
    file.write_text(CODE)
    other.write_text(CODE.replace(old, new))
    one, another = (provenance._hash_of([("a", path)]) for path in (file, other))
    assert (one == another) is is_the_same


def test_the_hash_of_a_step_covers_all_that_its_script_loads():
    """But the modules that only record."""
    script = SCRIPTS / "write_page.py"
    program = (
        "import runpy, sys; runpy.run_path(sys.argv[1], run_name='step')\n"
        "print(*(name for name in sys.modules if name.startswith('gst')))"
    )
    command = [sys.executable, "-c", program, script]
    loaded = set(subprocess.check_output(command, text=True).split())
    covered = {name.split()[0] for name, _ in provenance._parts_of(script)}
    assert loaded - covered <= provenance._RECORDING
    assert "gst.page.page" in loaded


def study(title, mesh, scans):
    inputs = {"mesh": mesh, "scan_folder": scans}
    own = {"results": ".", "specimen": None, "title": title, "inputs": inputs}
    return complete(own)


@pytest.mark.parametrize(
    ("title", "mesh", "scans", "refused"),
    [
        ("B", "a.stl", "a", False),
        ("A", "a.stl", "b", False),
        ("A", "other.stl", "a", False),
        ("A", "copy.stl", "b", False),
        ("A", "other.stl", "b", True),
        ("A", "missing.stl", "b", True),
        ("B", "copy.stl", "b", True),
    ],
)
def test_results_of_another_study_are_not_overwritten(
    tmp_path, monkeypatch, title, mesh, scans, refused
):
    """A study may get another title; or its mesh another name, or its scans another folder."""
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, {"a.stl": "stone", "copy.stl": "stone", "other.stl": "another"})
    now = study(title, mesh, scans)
    digests = {"a.stl": sha256("a.stl")}
    made = study_provenance(study("A", "a.stl", "a"), digests, None, "", software())
    Path("provenance.json").write_text(json.dumps(made))
    problem = pytest.raises(InputError, match=r"another study, 'A', of a\.stl")
    with problem if refused else nullcontext():
        refuse_other_study(now)
    for damaged in ("[]", '{"config": {}, "inputs": []}', "[" * 100_000):
        Path("provenance.json").write_text(damaged)
        refuse_other_study(now)
