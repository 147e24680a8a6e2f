"""The tiny study's specimen, with five patches: one rotated, one at the edge."""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from gstlib.specimen.generate import make_specimen
from gstlib.specimen.randomness import SpecimenParameters

CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="session")
def parameters():
    files = (CONFIG / f"{name}.yaml" for name in ("config", "tiny"))
    default, tiny = (yaml.safe_load(file.read_text())["specimen"] for file in files)
    return SpecimenParameters(**default | tiny)


@pytest.fixture(scope="session")
def patches():
    names = ["5", "7", "10", "13", "16"]
    return pd.DataFrame(
        {
            "patch": names,
            "x_mm": [4.5, 1.5, 4.5, 2.5, 0.5],
            "y_mm": [0.5, 1.5, 1.5, 2.5, 3.5],
            "rotation_deg": [0.0, 0.0, 30.0, 0.0, 0.0],
            "t0": [f"{name}_T0.plu" for name in names],
            "t1": [f"{name}_T1.plu" for name in names],
        }
    )


@pytest.fixture(scope="session")
def specimen(patches, parameters):
    return make_specimen(patches, parameters, square_mm=5.0, grid=50)


@pytest.fixture(scope="session")
def truth(specimen):
    return specimen.truth
