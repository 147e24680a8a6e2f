"""The library works where the application's packages are not installed."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import gstlib
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
inputs = json.loads(sys.argv[1])
config, patches = inputs["config"], pd.DataFrame(inputs["patches"])
made = make_specimen(patches, SpecimenParameters(**config["specimen"]), square_mm=5.0, grid=100)
study = Study(
    config, patches, read_mesh=lambda: made.mesh, read_scan=lambda *scan: made.scans[scan]
)
messages, first = [], patches.patch[0]
for refused in (
    lambda: read_scan(inputs["scan"]),
    lambda: measure_texture({first: study.prepared[first, "T0"]}, {}, **config["texture"]),
):
    try:
        refused()
    except InputError as error:
        messages.append(str(error))
json.dump({"force": study.pressures.force_N.tolist(), "messages": messages}, sys.stdout)
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
    config = read_config(CONFIG / "tiny.yaml") | {"use": None}
    patches = read_patches(CONFIG / "patches_tiny.tsv", size_mm=5.0, patch_size_mm=0.85)
    scan = tmp_path / "scan.sur"
    scan.write_bytes(b"DIGITAL SURF")
    inputs = {
        "config": config,
        "patches": patches.iloc[:3].to_dict("list"),
        "scan": str(scan),
    }
    done = subprocess.run(
        [sys.executable, "-S", "-c", PROGRAM, json.dumps(inputs)],
        env=os.environ | {"PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    # 22 MPa on 25 mm², of which the patches carry a part
    assert 0 < sum(result["force"]) < 22 * 25
    formats, texture = result["messages"]
    assert "scan.sur" in formats
    assert "gstlib[formats]" in formats
    assert "gstlib[texture]" in texture
