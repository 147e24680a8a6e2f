"""Provenance does not depend on the machine; source hashes follow the library."""

import hashlib
import json
import os
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
    refuse_unseen_change,
    source_hash,
    study_provenance,
)
from gstlib.errors import InputError
from gstlib.io.files import sha256

SCRIPTS = Path(__file__).parents[2] / "workflow/scripts"


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
    of_study = study_provenance({"x": 1}, [tmp_path / "two/b"], commit="abc", program="def")
    assert of_study["inputs"] == {str(tmp_path / "two/b"): hashlib.sha256(b"b").hexdigest()}
    assert of_study["software"]["commit"] == "abc"
    assert of_study["software"]["program"] == "def"
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


@pytest.mark.parametrize(
    ("file", "moved"),
    [
        ("gstlib/bem/halfspace.py", {"solve_patches", "draw_figures", "write_page"}),
        ("gst/page.css", {"draw_figures", "write_page"}),
        ("gst/figures/style.py", {"draw_figures", "write_page"}),
        ("gst/cli.py", set()),
    ],
)
def test_a_change_of_the_library_moves_the_hash_and_one_of_its_drawings_only_where_it_draws(
    tmp_path, monkeypatch, file, moved
):
    def hashes():
        _package_hash.cache_clear()
        names = ("solve_patches", "draw_figures", "write_page")
        return {name: source_hash(SCRIPTS / f"{name}.py") for name in names}

    before = hashes()
    for package in (gst, gstlib):
        copy = tmp_path / package.__name__
        shutil.copytree(Path(package.__file__).parent, copy)
        monkeypatch.setattr(package, "__file__", str(copy / "__init__.py"))
    assert hashes() == before
    with (tmp_path / file).open("a") as changed:
        changed.write("\n")
    after = hashes()
    assert {name for name in before if after[name] != before[name]} == moved


@pytest.mark.parametrize(
    ("title", "mesh", "refused"),
    [("A", "a.stl", False), ("B", "a.stl", False), ("A", "b.stl", False), ("B", "b.stl", True)],
)
def test_results_of_another_study_are_not_overwritten(tmp_path, title, mesh, refused):
    """A study may get another title, or its mesh another name."""
    made = {"config": {"title": "A", "inputs": {"mesh": "a.stl"}}}
    (tmp_path / "provenance.json").write_text(json.dumps(made))
    config = {"results": str(tmp_path), "title": title, "inputs": {"mesh": mesh}}
    if not refused:
        refuse_other_study(config)
        return
    with pytest.raises(InputError, match="another study, 'A'"):
        refuse_other_study(config)


def test_an_input_that_changed_and_kept_its_date_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scan, record = tmp_path / "5_T0.plu", tmp_path / "provenance.json"
    scan.write_bytes(b"before")
    record.write_text(json.dumps({"inputs": {"5_T0.plu": sha256(scan)}}))
    refuse_unseen_change(tmp_path)
    dates = scan.stat().st_atime_ns, scan.stat().st_mtime_ns
    scan.write_bytes(b"beside")
    refuse_unseen_change(tmp_path)  # Snakemake sees its later date
    os.utime(scan, ns=dates)
    with pytest.raises(InputError, match=r"touch '5_T0\.plu'"):
        refuse_unseen_change(tmp_path)
