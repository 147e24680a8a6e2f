"""The library works where the application's packages are not installed."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import gst
import gstlib
import pytest
from gst.config.patches import read_patches
from gst.config.reading import read_config

CONFIG = Path(__file__).parents[2] / "config"
ABSENT = (
    "click",
    "ducc0",
    "jinja2",
    "matplotlib",
    "snakemake",
    "surfalize",
    "SurfaceTopography",
    "yaml",
)
# A synthetic specimen, from its scans to the loss that one patch predicts for another.
PROGRAM = """
import importlib, json, pkgutil, sys
import pandas as pd
import gstlib
from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.specimen.generate import make_specimen
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.study import Study
from gstlib.change.texture import measure_texture

for module in pkgutil.walk_packages(gstlib.__path__, "gstlib."):
    importlib.import_module(module.name)
given = json.loads(sys.argv[1])
config, patches = given["config"], pd.DataFrame(given["patches"])
made = make_specimen(patches, SpecimenParameters(**config["specimen"]), square_mm=5.0, grid=100)
study = Study(
    config, patches, read_mesh=lambda: made.mesh, read_scan=lambda *of: made.scans[of]
)
said, first = [], patches.patch[0]
for refused in (
    lambda: read_scan(given["scan"]),
    lambda: measure_texture({first: study.prepared[first, "T0"]}, {}, **config["texture"]),
):
    try:
        refused()
    except InputError as error:
        said.append(str(error))
json.dump({"force": study.pressures.force_N.tolist(), "said": said}, sys.stdout)
"""


@pytest.fixture
def packages(tmp_path):
    """A folder with all that is installed here, but for the packages of the application."""
    folder = tmp_path / "packages"
    folder.mkdir()
    (folder / "gstlib").symlink_to(Path(gstlib.__file__).parent)
    for package in Path(sysconfig.get_paths()["purelib"]).iterdir():
        name = package.stem.split("-")[0]
        if package.suffix != ".pth" and name not in (*ABSENT, "gst", "gstlib"):
            (folder / package.name).symlink_to(package)
    return folder


def test_the_library_runs_without_the_packages_of_the_application(packages, tmp_path):
    config = read_config(CONFIG / "tiny.yaml")
    patches = read_patches(CONFIG / "patches_tiny.tsv", size_mm=5.0, patch_size_mm=0.85)
    scan = tmp_path / "scan.sur"
    scan.write_bytes(b"DIGITAL SURF")
    given = {"config": config, "patches": patches.to_dict("list"), "scan": str(scan)}
    done = subprocess.run(
        [sys.executable, "-S", "-c", PROGRAM, json.dumps(given)],
        env=os.environ | {"PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    # 22 MPa on 25 mm², of which the patches carry a part
    assert 0 < sum(found["force"]) < 22 * 25
    formats, texture = found["said"]
    assert "scan.sur" in formats
    assert "gstlib[formats]" in formats
    assert "gstlib[texture]" in texture


def test_the_command_says_which_extra_it_needs(packages):
    (packages / "gst").symlink_to(Path(gst.__file__).parent)
    done = subprocess.run(
        [sys.executable, "-S", "-m", "gst", "--help"],
        env=os.environ | {"PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("ERROR: gst: click is not installed.")
    assert "gstlib[workflow]" in done.stderr
