"""`make check`: all problems of a study at once, what a run would do, and an exit code."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT


def check(study, *arguments):
    return subprocess.run(
        [sys.executable, str(ROOT / "workflow/check.py"), study.config, *arguments],
        cwd=study.folder,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_shipped_studies(study):
    for config, code, said in [
        ("config/config.yaml", 0, "Nothing is wrong"),
        ("config/tiny.yaml", 0, "to be generated"),
        ("config/m12.yaml", 1, "files do not exist"),  # they are not public
    ]:
        study.config = config
        result = check(study)
        assert result.returncode == code, result.stderr
        assert said in result.stdout + result.stderr
        assert "elements" in result.stdout
        assert "E* = 12820 MPa, as given; 10346 MPa by the elastic constants" in result.stdout


def test_good_files(measured):
    result = check(measured)
    assert result.returncode == 0, result.stderr
    assert "64 × 64 points" in result.stdout
    assert " mm along its x, y, z; edges of " in result.stdout
    assert "scans       Sq " in result.stdout
    assert "WARNING" not in result.stderr
    assert [file.name for file in measured.results.iterdir()] == ["check.png"]


def test_everything_wrong_is_said_at_once(measured):
    data = measured.folder / "data"
    (data / "scans/7_T0.plu").write_bytes(b"too short")
    (data / "scans/5_T1.plu").unlink()
    measured.change(square={"frame": {"origin_mm": [300.0, 0.0, 0.0]}}, material={"poisson_1": 0.7})
    result = check(measured)
    assert result.returncode == 1
    for words in (
        ("4 problems",),
        ("material.poisson_1", "0.7"),
        ("7_T0.plu", "truncated"),
        ("5_T1.plu", "not exist"),
        ("mesh.stl", "square.frame"),
    ):
        assert all(word in result.stderr for word in words), words
    assert "Traceback" not in result.stderr


def test_what_is_right_is_looked_at_beside_a_faulty_table_and_a_missing_mesh(measured):
    table = measured.folder / "config/patches_tiny.tsv"
    table.write_text(table.read_text().replace("\t0.50\t", "\t0.30\t", 1))
    data = measured.folder / "data"
    (data / "mesh.stl").unlink()
    (data / "scans/7_T0.plu").write_bytes(b"too short")
    measured.change(macroscale={"grid": -4})
    result = check(measured)
    assert result.returncode == 1
    for words in (
        ("4 problems",),
        ("macroscale.grid", "-4"),
        ("patch 5", "sticks out"),
        ("mesh: data/mesh.stl",),
        ("7_T0.plu", "truncated"),
    ):
        assert all(word in result.stderr for word in words), words
    assert "Traceback" not in result.stderr


def test_nothing_is_said_of_scans_that_cannot_be_read(measured):
    for scan in (measured.folder / "data/scans").iterdir():
        scan.write_bytes(b"too short")
    result = check(measured)
    assert result.returncode == 1
    assert "patches     6 of 0.85 mm, 6 steps each" in result.stdout
    assert "cost        not known" in result.stdout
    assert "points" not in result.stdout


def test_a_run_begins_with_the_check(measured):
    scans = measured.folder / "data/scans"
    for name in ("7_T0.plu", "5_T1.plu"):
        (scans / name).write_bytes((scans / name).read_bytes()[:3000])
    result = measured.run()
    said = result.stdout + result.stderr
    assert result.returncode != 0
    assert "2 problems" in said
    assert "7_T0.plu" in said
    assert "5_T1.plu" in said
    assert "Traceback" not in said
    assert not list(measured.results.rglob("*.h5"))


def make(target, config):
    """`make TARGET CONFIG=...` with the environment under test."""
    command = ["make", "-o", ".venv/ready", f"BIN={Path(sys.executable).parent}", target]
    # the tests themselves may run under make, which hands on what it was called with
    environment = {key: value for key, value in os.environ.items() if "MAKE" not in key}
    return subprocess.run(
        [*command, f"CONFIG={config}"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("target", ["study", "plan", "sweep", "check", "unlock"])
def test_a_config_that_is_no_yaml_is_refused_in_one_sentence(tmp_path, target):
    config = tmp_path / "mine.yaml"
    config.write_text("title: my: stone\n")
    result = make(target, config)
    assert result.returncode != 0
    assert result.stdout == ""
    error, made = result.stderr.strip().splitlines()
    assert error.startswith(f"ERROR: {config}: is not YAML: line 1, 'title: my: stone'")
    assert made.startswith("make: ***")


@pytest.mark.parametrize("target", ["check", "plan", "unlock"])
def test_the_path_of_the_config_may_have_blanks(tmp_path, target):
    config = tmp_path / "Fläche 1" / "mine.yaml"
    config.parent.mkdir()
    config.write_bytes((ROOT / "config/tiny.yaml").read_bytes())
    result = make(target, config)
    assert result.returncode == 0, result.stderr


def test_a_project_in_a_folder_with_blanks_is_refused(study):
    project = study.folder / "Meine Steine"
    project.mkdir()
    (project / ".venv").symlink_to(sys.prefix)
    python = str(project / ".venv/bin/python")
    for command in (
        [python, str(ROOT / "workflow/check.py"), study.config],
        [python, *study.command("--dry-run")[1:]],
    ):
        result = subprocess.run(
            command, cwd=study.folder, capture_output=True, text=True, check=False
        )
        assert result.returncode != 0
        assert "has a space in it. Move the project's folder" in result.stdout + result.stderr
        assert "Traceback" not in result.stderr
