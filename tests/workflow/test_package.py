"""The wheel, installed where there is no clone: `gst` lays out a study and runs it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, Study

UV = [sys.executable, "-m", "uv"]


def run(*command, cwd=None):
    # not the clone's gstlib, even where the tests' own is found by a path
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = list(map(str, command))
    result = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def interpreter(version):
    """A Python of this version, on the PATH or of those that pyenv keeps; None if there is none."""
    named = shutil.which(f"python{version}")
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for python in filter(None, [named, *kept]):
        asked = subprocess.run([python, "-c", ""], capture_output=True, check=False)
        if asked.returncode == 0:  # and no shim without a Python behind it
            return python
    return None


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel, which is built from the source distribution."""
    folder = tmp_path_factory.mktemp("dist")
    run(*UV, "build", "--no-build-isolation", "--python", sys.executable, "-o", folder, ROOT)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_installed_without_the_repository(built, version, finished_tiny, tmp_path):
    if (python := interpreter(version)) is None:
        pytest.skip(f"needs Python {version} on the PATH or in ~/.pyenv")
    run(*UV, "venv", "--python", python, tmp_path / "venv")
    wheel = next(built.glob("*.whl"))
    installed = tmp_path / "venv/bin"
    run(
        *UV,
        "pip",
        "install",
        "--python",
        installed / "python",
        "--constraints",
        ROOT / "requirements.lock",
        f"gstlib[workflow] @ {wheel.as_uri()}",
    )
    said = run(installed / "python", "-c", "import gst; print(gst.ROOT)", cwd=tmp_path)
    assert Path(said.strip()).is_relative_to(tmp_path / "venv")
    gst = installed / "gst"
    said = run(gst, "new", "stone", "--like", "tiny", cwd=tmp_path)
    assert "stone/config/patches_tiny.tsv" in said
    study = Study(tmp_path / "stone")
    run(gst, "check", study.config, cwd=study.folder)
    said = run(gst, "study", study.config, cwd=study.folder)
    assert "Open results-tiny/index.html in a browser." in said
    assert study.tables() == finished_tiny.tables()
    report = (study.results / "report.html").read_text(encoding="utf-8")
    assert len(report) > 1e6
    assert str(study.folder) not in report
