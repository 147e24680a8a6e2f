"""Provenance does not depend on the machine; source hashes follow what a script uses, no more."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest

import gstlib
from gstlib.provenance import commit, provenance, source_hash, study_provenance


def test_provenance_does_not_depend_on_folder_or_order(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        for name in "ab":
            (tmp_path / folder / name).write_text(name)
    one = provenance([tmp_path / "one/a", tmp_path / "one/b"], {"x": 1, "y": [2]})
    two = provenance([tmp_path / "two/b", tmp_path / "two/a"], {"y": [2], "x": 1})
    assert one == two
    assert json.loads(one["settings"]) == {"x": 1, "y": [2]}
    assert json.loads(one["input_sha256"])["a"] == hashlib.sha256(b"a").hexdigest()
    assert one["gstlib_version"] == gstlib.__version__
    of_study = study_provenance({"x": 1}, [tmp_path / "two/b"], commit="abc")
    assert of_study["inputs"] == {str(tmp_path / "two/b"): hashlib.sha256(b"b").hexdigest()}
    assert of_study["software"]["commit"] == "abc"
    assert {"numpy", "scipy", "snakemake"} <= of_study["software"]["packages"].keys()


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


SCRIPTS = {
    "couple": "from gstlib.study import couple_scales",
    "solve": "from gstlib.study import solve_macroscale",
    "all": "from gstlib.study import Study",
    "read": "from gstlib.io.store import read_dataset",
    "sections": "from gstlib.study import STUDY_SECTIONS",
    "page": "from gstlib.page import render",
}


@pytest.mark.parametrize(
    ("file", "old", "new", "moved"),
    [
        ("study.py", "", "# a comment\n", set()),
        (
            "study.py",
            "by_mesh = patch_pressures(",
            "by_mesh = abs(",
            {"couple", "all"},
        ),
        ("study.py", "every_step=True", "every_step=False", {"solve"}),
        ("study.py", '"uncertainty", "selection"', '"selection"', {"sections"}),
        ("coupling.py", "", "1\n", {"couple", "all"}),  # imported by few stages
        (
            "bem/halfspace.py",
            "",
            "1\n",
            {"couple", "solve", "all"},
        ),  # by relative imports, some steps away
        ("io/store.py", "", "1\n", {"read"}),
        ("page.css", "", "p {}\n", {"page"}),
        ("__init__.py", "", "1\n", set(SCRIPTS)),  # runs before any module
        ("figures/__init__.py", "", "1\n", {"page"}),
    ],
)
def test_source_hash_follows_what_a_script_uses(tmp_path, monkeypatch, file, old, new, moved):
    def hashes():
        return {name: source_hash(tmp_path / f"{name}.py") for name in SCRIPTS}

    for name, text in SCRIPTS.items():
        (tmp_path / f"{name}.py").write_text(text)
    before = hashes()  # of the library itself
    package = tmp_path / "gstlib"
    shutil.copytree(Path(gstlib.__file__).parent, package)
    monkeypatch.setattr(gstlib, "__file__", str(package / "__init__.py"))
    text = (package / file).read_text()
    assert old in text
    (package / file).write_text(text.replace(old, new, 1) if old else text + new)
    after = hashes()
    assert {name for name in SCRIPTS if after[name] != before[name]} == moved
