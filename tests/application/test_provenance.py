"""Provenance does not depend on the machine; source hashes follow the library."""

import ast
import json
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import gst
import gstlib
import pytest
from gst.run import provenance
from gst.run.provenance import commit, refuse_other_study, software, source_hash, study_provenance
from gstlib.errors import InputError
from gstlib.io.files import sha256

SCRIPTS = Path(__file__).parents[2] / "workflow/scripts"
RECORDING = [("run", name) for name in ("chain", "logs", "provenance", "received")]


def test_provenance_has_the_versions_on_which_the_steps_ran():
    written = study_provenance({"x": 1}, {"b": "ab"}, "abc", "def", software())
    assert written["inputs"] == {"b": "ab"}
    software_of = written["software"]
    assert (software_of["commit"], software_of["program"]) == ("abc", "def")
    assert software_of["python"] == platform.python_version()
    assert {"numpy", "scipy", "snakemake"} <= software_of["packages"].keys()


def test_commit_of_a_folder_and_its_changes(tmp_path):
    def git(*arguments):
        as_me = ["-c", "user.name=me", "-c", "user.email=me@here"]
        subprocess.run(["git", "-C", tmp_path, *as_me, *arguments], check=True, capture_output=True)

    assert commit(tmp_path) is None
    git("init")
    for name in ("Snakefile", "config.yaml"):
        (tmp_path / name).write_text("a")
        git("add", name)
    git("commit", "-m", "first")
    commit.cache_clear()
    clean = commit(tmp_path)
    assert len(clean) == 40
    for name, said in (("config.yaml", clean), ("Snakefile", f"{clean}+")):
        (tmp_path / name).write_text("b")
        commit.cache_clear()
        assert commit(tmp_path) == said


STEPS = "solve_patches", "tabulate_texture", "draw_figures", "write_page"


def hashes():
    source_hash.cache_clear()
    return {name: source_hash(SCRIPTS / f"{name}.py") for name in STEPS}


MOVED = {
    "gst/page/page.css": {"write_page"},
    "gst/cli.py": set(),
    "gst/run/chain.py": set(),
    "gstlib/change/texture.py": {"tabulate_texture"},
    "gstlib/surfaces/grid.py": set(STEPS),
    "gstlib/__init__.pyi": set(),
}


def test_the_hash_of_a_step_moves_with_the_modules_that_it_runs_on(tmp_path, monkeypatch):
    before = hashes()
    for package in (gst, gstlib):
        copy = tmp_path / package.__name__
        shutil.copytree(Path(package.__file__).parent, copy, ignore=lambda *_: ["__pycache__"])
        monkeypatch.setattr(package, "__file__", str(copy / "__init__.py"))
    assert hashes() == before
    for name, steps in MOVED.items():
        with (tmp_path / name).open("a") as file:
            file.write("\n")
        after = hashes()
        assert {step for step in STEPS if after[step] != before[step]} == steps, name
        before = after


@pytest.mark.parametrize("step", STEPS)
def test_the_hash_of_a_step_covers_all_that_its_script_loads(step):
    script = SCRIPTS / f"{step}.py"
    assert loaded_by(script) <= {file for _, file in provenance._parts_of(script)}


def test_the_schema_of_the_tables_belongs_to_what_writes_one(tmp_path, monkeypatch):
    schema = tmp_path / "workflow/schemas/tables.yaml"
    schema.parent.mkdir(parents=True)
    shutil.copy(gst.ROOT / schema.relative_to(tmp_path), schema)
    before = hashes()
    monkeypatch.setattr(gst, "ROOT", tmp_path)
    assert hashes() == before
    schema.write_text(schema.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert {name for name, is_now in hashes().items() if is_now != before[name]} == {
        "tabulate_texture",
        "write_page",
    }


def loaded_by(script):
    """The files of our packages that a script loads when it starts, but those that only record."""
    program = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='step')\n"
    program += "print([m.__file__ for n, m in sys.modules.items() if n.startswith('gst')])"
    said = subprocess.check_output([sys.executable, "-c", program, script], text=True)
    files = map(Path, ast.literal_eval(said))
    return {file for file in files if (file.parent.name, file.stem) not in RECORDING}


@pytest.mark.parametrize(
    ("title", "mesh", "scans", "refused"),
    [
        ("B", "a.stl", "a", False),
        ("A", "a.stl", "b", False),
        ("A", "corrected.stl", "a", False),
        ("A", "copy.stl", "b", False),
        ("A", "other.stl", "b", True),
        ("A", "missing.stl", "b", True),
        ("A", None, None, True),
        ("B", "copy.stl", "b", True),
    ],
)
def test_results_of_another_study_are_not_overwritten(
    tmp_path, monkeypatch, title, mesh, scans, refused
):
    """A study may get another title; or its mesh another name, or its scans another folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.stl", "copy.stl", "corrected.stl", "other.stl"):
        Path(name).write_text("stone" if name in {"a.stl", "copy.stl"} else name)
    made = {"config": {"title": "A", "inputs": {"mesh": "a.stl", "scan_folder": scans and "a"}}}
    made["inputs"] = {"a.stl": sha256("a.stl")}
    Path("provenance.json").write_text(json.dumps(made))
    for damaged in ("[]", '{"config": []}', '{"config": {}, "inputs": []}', "[" * 100_000):
        Path("provenance.json").write_text(damaged)
        refuse_other_study({"results": ".", "title": title, "inputs": None})
    Path("provenance.json").write_text(json.dumps(made))
    inputs = mesh and {"mesh": mesh, "scan_folder": scans}
    config = {"results": ".", "title": title, "inputs": inputs}
    if not refused:
        refuse_other_study(config)
        return
    with pytest.raises(InputError, match=r"another study, 'A', of a\.stl"):
        refuse_other_study(config)
