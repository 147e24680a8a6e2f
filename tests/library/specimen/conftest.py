"""The tiny study's specimen, with five patches: one rotated, one at the edge."""

from pathlib import Path

import pytest
import yaml
from contacts import written

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
    return written(
        """
        patch, x_mm, y_mm, rotation_deg, t0,        t1
        5,     4.5,  0.5,  0.0,          5_T0.plu,  5_T1.plu
        7,     1.5,  1.5,  0.0,          7_T0.plu,  7_T1.plu
        10,    4.5,  1.5,  30.0,         10_T0.plu, 10_T1.plu
        13,    2.5,  2.5,  0.0,          13_T0.plu, 13_T1.plu
        16,    0.5,  3.5,  0.0,          16_T0.plu, 16_T1.plu
        """
    )


@pytest.fixture(scope="session")
def specimen(patches, parameters):
    return make_specimen(patches, parameters, square_mm=5.0, grid=50)


@pytest.fixture(scope="session")
def truth(specimen):
    return specimen.truth
