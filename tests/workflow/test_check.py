"""`make check`: all problems of a study at once, what a run would do, and an exit code."""

import os
import subprocess
import sys

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


def test_good_files(measured):
    result = check(measured)
    assert result.returncode == 0, result.stderr
    assert "64 × 64 points" in result.stdout
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
