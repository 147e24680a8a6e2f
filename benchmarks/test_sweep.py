"""What a sweep asks for can be run, and its changes are those from the study."""

import numpy as np
import pandas as pd
import pytest
import yaml
from runner import ROOT
from specimens import merged
from sweep import SETTINGS, changes_table

from gst.config.reading import config_problems, read_config

CONFIGS = ROOT / "config"


def test_every_shipped_setting_changes_the_default_study_to_one_that_can_be_run():
    config = read_config(CONFIGS / "config.yaml")
    for values in yaml.safe_load(SETTINGS.read_text()).values():
        for changes in values:
            changed = merged(config, changes)
            assert config_problems(changed) == []
            assert changed != config, changes


def test_changes_are_those_from_the_study():
    outcomes = {}
    for value, results in (("", [30.0, 10.0, 0.2]), ("10", [20.0, 0.0, 0.1])):
        rows = {
            "output": ["pressure_MPa", "pressure_MPa", "gain(mcc)"],
            "patch": ["1", "2", ""],
        }
        table = pd.DataFrame(rows | {"result": results, "low": np.nan, "high": np.nan})
        outcomes["force" if value else "", value] = table
    change = changes_table(outcomes).set_index(["value", "output", "patch"]).change
    assert change["10", "pressure_MPa", "1"] == -10.0
    assert change["10", "gain(mcc)", ""] == pytest.approx(-0.1)
    assert (change[""] == 0).all()
    # 10 + 10 of 40 MPa: what one loses and another gains does not cancel
    assert change["10", "relative_change(pressure_MPa)", ""] == pytest.approx(0.5)
