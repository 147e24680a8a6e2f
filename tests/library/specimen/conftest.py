"""The tiny study's specimen, with five patches: one rotated, one at the edge."""

import dataclasses
from functools import partial
from pathlib import Path

import pandas as pd
import pytest
import yaml
from gstlib.specimen.generate import make_specimen, make_specimens, write_specimen
from gstlib.specimen.law import wear_depth
from gstlib.specimen.randomness import SpecimenParameters

CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="session")
def parameters():
    files = (CONFIG / f"{name}.yaml" for name in ("config", "tiny"))
    default, tiny = (yaml.safe_load(file.read_text())["specimen"] for file in files)
    return SpecimenParameters(**default | tiny)


@pytest.fixture(scope="session")
def patches():
    places = {"x_mm": [4.5, 1.5, 4.5, 2.5, 0.5], "y_mm": [0.5, 1.5, 1.5, 2.5, 3.5]}
    places |= {"rotation_deg": [0.0, 0.0, 30.0, 0.0, 0.0]}
    table = pd.DataFrame({"patch": ["5", "7", "10", "13", "16"]} | places)
    return table.assign(t0=table.patch + "_T0.plu", t1=table.patch + "_T1.plu")


@pytest.fixture(scope="session")
def make():
    """Specimens in memory, by where their wear lies."""

    def make(patches, parameters, square_mm=5.0):
        wear = {name: partial(wear_depth, placement=name) for name in ("summits", "archard")}
        return make_specimens(patches, parameters, square_mm=square_mm, grid=50, wear=wear)

    return make


@pytest.fixture(scope="session")
def made(make, patches, parameters):
    return make(patches, parameters)


@pytest.fixture(scope="session")
def write(tmp_path_factory, parameters):
    """Write a specimen; the folder that it lies in."""

    def write(patches, **changes):
        folder = tmp_path_factory.mktemp("specimen")
        changed = dataclasses.replace(parameters, **changes)
        write_specimen(
            make_specimen(patches, changed, square_mm=5.0, grid=50),
            mesh=folder / "mesh.stl",
            scan_folder=folder / "scans",
            truth=folder / "truth.h5",
            surface=folder / "surface.h5",
        )
        return folder

    return write


@pytest.fixture(scope="session")
def specimen(made):
    return made["summits"]


@pytest.fixture(scope="session")
def truth(specimen):
    return specimen.truth
