"""The sweep of `make power`: a trial is the study, and its tables are the same again."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml

from gstlib.config import study_contact_modulus
from gstlib.io.patches import read_patches
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.power import try_specimen
from gstlib.specimen import SpecimenParameters

from conftest import ROOT  # isort: skip

SECTIONS = [
    *("square", "macroscale", "scans", "preprocessing", "registration", "traces"),
    *("selection", "microscale"),
]


def test_a_trial_is_the_study(finished_tiny):
    """Same specimen, same settings: what the study stored is what the trial gives."""
    config = json.loads((finished_tiny.results / "provenance.json").read_text())["config"]
    side = config["scans"]["size_mm"]
    patches = read_patches(
        finished_tiny.folder / config["patches"],
        schema=ROOT / "workflow/schemas/patches.schema.yaml",
        size_mm=config["square"]["size_mm"],
        patch_size_mm=side,
    )
    trials = list(
        try_specimen(
            patches,
            SpecimenParameters(**config["specimen"]),
            patch_mm=side,
            contact_modulus_MPa=study_contact_modulus(config["material"]),
            **{name: config[name] for name in SECTIONS},
        )
    )
    pressures = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    studied = pressures[pressures.in_study].set_index("patch").pressure_MPa
    on_summits = {trial.patch: trial for trial in trials if trial.wear == "summits"}
    assert list(on_summits) == list(studied.index)
    for patch, trial in on_summits.items():
        assert trial.pressure == pytest.approx(studied[patch], rel=1e-4)
        contact = read_dataset(finished_tiny.results / f"microscale/{patch}.h5")
        peak = float(contact.pressure.max())
        np.testing.assert_allclose(trial.contact.pressure, contact.pressure, atol=1e-3 * peak)
        stored = read_dataset(finished_tiny.results / f"registered/{patch}.h5")
        np.testing.assert_allclose(trial.registered.change, stored.change, atol=1e-9)
        assert (trial.registered.loss == stored.loss).all()
    at_random = {trial.patch: trial for trial in trials if trial.wear == "random"}
    for patch in on_summits.keys() & at_random.keys():
        one, other = on_summits[patch], at_random[patch]
        assert (one.contact.pressure == other.contact.pressure).all()
        assert (one.registered.loss != other.registered.loss).any()


@pytest.fixture
def sweep(study):
    """Two specimens of the sweep, as small as those of the tiny study."""
    study.config = "config/power.yaml"
    study.change(
        patches="config/patches_tiny.tsv",
        specimen={"mesh_edge_mm": 0.6, "cut_off_wavelength_mm": 1.2}
        | {"scan_points": 64, "scan_spacing_um": 13.28, "unmeasured_size_um": 30.0},
        macroscale={"grid": 40},
        power={"specimens": 2},
    )
    return study


def test_a_sweep_and_the_same_again(sweep):
    result = sweep.run("power", cores=2)
    assert result.returncode == 0, result.stderr
    tables = sweep.tables()
    assert set(tables) == {"power.csv", "power_p_values.csv"}
    rates = read_table(sweep.results / "tables/power.csv")
    assert set(rates.wear) == {"summits", "random"}
    assert rates[["rate", "low", "high"]].stack().between(0, 1).all()
    p_values = read_table(sweep.results / "tables/power_p_values.csv")
    first = yaml.safe_load((ROOT / "config/power.yaml").read_text())["power"]["first_seed"]
    assert set(p_values.seed) == {first, first + 1}
    of_patches = p_values[p_values.test == "f1"]
    scored = pd.concat(map(read_table, sorted(sweep.results.glob("power/*_patches.csv"))))
    assert len(of_patches) == len(scored)
    assert (sweep.results / "figures/power.png").stat().st_size > 0

    (sweep.results / f"power/{first + 1}_p_values.csv").unlink()
    result = sweep.run("power", cores=1)
    assert result.returncode == 0, result.stderr
    assert sweep.tables() == tables


def test_a_sweep_is_no_part_of_a_study(sweep):
    assert sweep.planned().isdisjoint({"try_specimen", "rate_claims", "plot_power"})
