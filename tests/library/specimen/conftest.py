import dataclasses
from pathlib import Path

import pandas as pd
import pytest

from gstlib.io.store import read_dataset
from gstlib.specimen import SpecimenParameters, generate_specimen

SQUARE_MM, GRID = 5.0, 50
_TINY = {
    "seed": 9,
    "outer_size_mm": [100.38, 80.57, 29.5],
    "concavity_mm": 0.5,
    "mesh_edge_mm": 0.6,
    "mesh_noise_um": 0.5,
    "hurst_exponent": 0.8,
    "roll_off_wavelength_mm": 2.5,
    "cut_off_wavelength_mm": 1.2,
    "macroscale_rms_um": 12.0,
    "shortest_wavelength_points": 4.0,
    "scan_points": 64,
    "scan_spacing_um": 13.28,
    "margin_mm": 0.25,
    "placement_error_um": 30.0,
    "relocation_error_um": 40.0,
    "rotation_error_deg": 0.05,
    "poor_overlap_share": 0.2,
    "tilt_mrad": 3.0,
    "noise_um": 0.1,
    "spike_share": 0.005,
    "spike_height_um": [15.0, 60.0],
    "unmeasured_share": 0.01,
    "unmeasured_size_um": 30.0,
    "wear_placement": "summits",
    "wear_share": 0.25,
    "wear_chance_um": 5.0,
    "wear_chance_length_um": 250.0,
    "wear_reference_length_um": 250.0,
    "wear_reach_sigma": 1.0,
    "chips_per_mm2": 40.0,
    "chip_radius_um": 15.0,
    "chip_depth_share": 0.15,
    "valley_share": 0.02,
    "valley_depth_um": 2.0,
    "valley_size_um": 40.0,
    "wear_threshold_um": 0.5,
}


@dataclasses.dataclass(frozen=True)
class Files:
    """Where a specimen was written."""

    folder: Path

    @property
    def mesh(self):
        return self.folder / "mesh.stl"

    @property
    def truth(self):
        return self.folder / "truth.h5"

    def scan(self, patch, epoch):
        return self.folder / "scans" / f"{patch}_{epoch}.plu"


@pytest.fixture(scope="session")
def parameters():
    return SpecimenParameters(**_TINY)


@pytest.fixture(scope="session")
def patches():
    names = ["5", "7", "10", "13", "16"]
    return pd.DataFrame(
        {
            "patch": names,
            "x_mm": [4.5, 1.5, 4.5, 2.5, 0.5],
            "y_mm": [0.5, 1.5, 1.5, 2.5, 3.5],
            "t0": [f"{name}_T0.plu" for name in names],
            "t1": [f"{name}_T1.plu" for name in names],
        }
    )


@pytest.fixture(scope="session")
def make(tmp_path_factory):
    def make(patches, parameters):
        files = Files(tmp_path_factory.mktemp("specimen"))
        generate_specimen(
            patches,
            mesh=files.mesh,
            scan_folder=files.folder / "scans",
            truth=files.truth,
            square_mm=SQUARE_MM,
            grid=GRID,
            parameters=parameters,
        )
        return files

    return make


@pytest.fixture(scope="session")
def specimen(make, patches, parameters):
    return make(patches, parameters)


@pytest.fixture(scope="session")
def truth(specimen):
    return read_dataset(specimen.truth)
