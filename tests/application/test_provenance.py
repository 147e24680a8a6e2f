"""Provenance does not depend on the machine; source hashes follow the library."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import gst
import gstlib
import pytest
from gst.provenance import (
    _package_hash,
    commit,
    provenance,
    refuse_other_study,
    source_hash,
    study_provenance,
)
from gstlib.errors import InputError
from gstlib.io.files import sha256

CONTENT = "of a mesh " * 200_000  # what differs is at its end
SCRIPTS = Path(__file__).parents[2] / "workflow/scripts"


def test_provenance_does_not_depend_on_folder_or_order(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        for name in "ab":
            (tmp_path / folder / name).write_text(CONTENT + name)
    one = provenance([tmp_path / "one/a", tmp_path / "one/b"], {"x": 1, "y": [2]})
    two = provenance([tmp_path / "two/b", tmp_path / "two/a"], {"y": [2], "x": 1})
    assert one == two
    assert json.loads(one["settings"]) == {"x": 1, "y": [2]}
    digests = {name: hashlib.sha256((CONTENT + name).encode()).hexdigest() for name in "ab"}
    assert json.loads(one["input_sha256"]) == digests
    assert one["gstlib_version"] == gstlib.__version__
    path = tmp_path / "two/b"
    of_study = study_provenance({"x": 1}, [path], commit="abc", program="def")
    assert of_study["inputs"] == {str(path): digests["b"]}
    software = of_study["software"]
    assert (software["commit"], software["program"]) == ("abc", "def")
    assert {"numpy", "scipy", "snakemake"} <= software["packages"].keys()


def test_commit_of_a_folder_and_its_changes(tmp_path):
    def git(*arguments):
        as_me = ["-c", "user.name=me", "-c", "user.email=me@here"]
        subprocess.run(["git", "-C", tmp_path, *as_me, *arguments], check=True, capture_output=True)

    assert commit(tmp_path) is None
    git("init")
    (tmp_path / "a").write_text("a")
    git("add", "a")
    git("commit", "-m", "first")
    commit.cache_clear()
    clean = commit(tmp_path)
    assert len(clean) == 40
    (tmp_path / "a").write_text("b")
    commit.cache_clear()
    assert commit(tmp_path) == f"{clean}+"


def imported(file, packages):
    """The modules of gst, by name, that a file imports, and those that these import."""
    found, ahead = set(), [file]
    while ahead:
        names = re.findall(
            r"^ *(?:from|import) gst[. ](?:import )?([a-z]\w*)", ahead.pop().read_text(), re.M
        )
        for name in set(names) - found:
            found.add(name)
            inside = packages / "gst" / name
            ahead += [inside.with_suffix(".py")] if not inside.is_dir() else inside.glob("*.py")
    return found


def test_the_hash_of_a_step_moves_with_every_module_that_it_runs_on(tmp_path, monkeypatch):
    scripts = {
        name: SCRIPTS / f"{name}.py" for name in ("solve_patches", "draw_figures", "write_page")
    }

    def hashes():
        _package_hash.cache_clear()
        return {name: source_hash(script) for name, script in scripts.items()}

    before = hashes()
    for package in (gst, gstlib):
        copy = tmp_path / package.__name__
        shutil.copytree(Path(package.__file__).parent, copy, ignore=lambda *_: ["__pycache__"])
        monkeypatch.setattr(package, "__file__", str(copy / "__init__.py"))
    assert hashes() == before
    used = {name: imported(SCRIPTS / f"{name}.py", tmp_path) for name in scripts}
    assert {"verdict", "figures", "viewer"} < used["write_page"]
    recording = {"logs", "made", "provenance"}  # these shape no result
    for file in sorted(tmp_path.rglob("*.*")):
        package, part = file.relative_to(tmp_path).parts[:2]
        file.write_text((content := file.read_text()) + "\n")
        after = hashes()
        moved = {name for name in scripts if after[name] != before[name]}
        file.write_text(content)
        if package == "gstlib":
            assert moved == set(scripts), file
        else:
            stem = part.split(".")[0]
            assert moved >= {n for n in scripts if stem in used[n] - recording}, file
            assert "solve_patches" not in moved, file
            assert moved == set() or stem != "cli"


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
    inputs = mesh and {"mesh": mesh, "scan_folder": scans}
    config = {"results": ".", "title": title, "inputs": inputs}
    if not refused:
        refuse_other_study(config)
        return
    with pytest.raises(InputError, match=r"another study, 'A', of a\.stl"):
        refuse_other_study(config)
