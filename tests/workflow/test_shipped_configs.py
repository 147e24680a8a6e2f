"""Every config that we ship plans a whole study."""

from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import ROOT

CONFIGS = sorted(file.name for file in (ROOT / "config").glob("*.yaml"))


def place_inputs(folder: Path, config: dict) -> None:
    """Empty files where the config expects measured ones: a plan looks only at their presence."""
    if not config.get("inputs"):
        return
    inputs = config["inputs"]
    patches = pd.read_csv(
        folder / config["patches"], sep="\t", comment="#", dtype=str, keep_default_na=False
    )
    scans = {*patches.t0, *patches.get("t1", [])} - {""}
    files = [inputs["mesh"], *(f"{inputs['scan_folder']}/{name}" for name in scans)]
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).touch()


@pytest.mark.parametrize("config", CONFIGS)
def test_config_plans_a_study(study, config):
    study.config = f"config/{config}"
    place_inputs(study.folder, yaml.safe_load((study.folder / study.config).read_text()))
    planned = study.planned()
    assert {"solve_macroscale", "couple_scales", "tabulate_preprocessing"} <= planned


def test_configs_are_found():
    assert {"config.yaml", "m12.yaml", "own.yaml", "pebble.yaml", "tiny.yaml"} <= set(CONFIGS)


def test_own_stone_is_that_of_its_own_constants():
    """What the paper chose to print, or to expect, does not come along with a copied config."""
    own = yaml.safe_load((ROOT / "config/own.yaml").read_text())
    assert own["material"]["contact_modulus_MPa"] is None
    assert not {"published", "validation", "preprocessing"} & set(own)
