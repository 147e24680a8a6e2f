"""What others get: the wheel, installed where there is no clone, and the package of a study."""

import shutil
import sys
from functools import partial

import pytest

from gst.share.package import pack_study

from .conftest import ROOT, Study, printed, run

pytestmark = pytest.mark.slow

UV = [sys.executable, "-m", "uv"]


# not the clone's gstlib, even where the tests' own is found by a path
succeed = partial(printed, PYTHONPATH="")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with the wheel, which is built from the source distribution."""
    folder = tmp_path_factory.mktemp("dist")
    command = *UV, "build", "--no-build-isolation", "--python", sys.executable
    succeed(*command, "-o", folder, ROOT)
    return folder


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_installed_without_the_repository(built, version, finished_tiny, tmp_path):
    made = run(*UV, "venv", "--no-python-downloads", "-p", version, tmp_path / "venv")
    if made.returncode != 0:
        pytest.skip(f"needs a Python {version} that uv finds")
    installed = tmp_path / "venv/bin"
    wheel = next(built.glob("*.whl")).as_uri()
    command = [*UV, "pip", "install", "--python", installed / "python"]
    command += ["--constraints", ROOT / "requirements.lock"]
    command += ["--build-constraints", ROOT / "requirements-build.lock"]
    succeed(*command, f"gstlib[workflow] @ {wheel}")
    gst = installed / "gst"
    succeed(gst, "new", "stone", "--like", "tiny", cwd=tmp_path)
    study = Study(tmp_path / "stone")
    message = succeed(gst, "study", study.config, cwd=study.folder)
    assert "Open results-tiny/index.html in a browser." in message
    assert study.tables() == finished_tiny.tables()


# --- The package of a study ------------------------------------------------------------------


def test_a_package_makes_its_results_again(finished_tiny, tmp_path):
    """With the packages that it pins, here this environment's, and no clone."""
    pack_study(finished_tiny.results, tmp_path / "tiny.zip")
    alone = tmp_path / "alone"
    shutil.unpack_archive(tmp_path / "tiny.zip", alone)
    study = Study(alone, "config/study.yaml")
    command = sys.executable, "-m", "gst", "study", study.config
    printed(*command, cwd=alone, PYTHONPATH="src")
    assert study.tables() == finished_tiny.tables()
