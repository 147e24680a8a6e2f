"""What a sweep asks for can be run, and its changes are those from the study."""

import numpy as np
import pandas as pd
import pytest
import yaml
from runner import ROOT
from specimens import merged
from sweep import SETTINGS, changes_table, main

from gst.config.reading import config_problems, read_config

CONFIGS = ROOT / "config"


def test_merged_replaces_what_is_stated_and_nothing_else():
    config = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merged(config, {"a": {"b": {"e": 3}}}) == {"a": {"b": {"e": 3}, "c": 2}, "d": [1, 2]}
    assert config == {"a": {"b": 1, "c": 2}, "d": [1, 2]}


def test_every_shipped_setting_changes_the_default_study_to_one_that_can_be_run():
    config = read_config(CONFIGS / "config.yaml")
    for values in yaml.safe_load(SETTINGS.read_text()).values():
        for changes in values:
            changed = merged(config, changes)
            assert config_problems(changed) == []
            assert changed != config, changes


def test_a_study_without_patches_is_refused():
    with pytest.raises(SystemExit, match="has no patch table"):
        main(["--config", str(CONFIGS / "mesh_only.yaml")])


def test_changes_are_those_from_the_study():
    pressures = {"": [30.0, 10.0], "10": [20.0, 0.0], "30": [38.0, 14.0]}
    scores = {"": 0.2, "10": 0.1, "30": 0.3}
    outcomes = {
        ("force" if value else "", value): pd.DataFrame(
            {
                "output": ["pressure_MPa", "pressure_MPa", "gain(mcc)"],
                "patch": ["1", "2", ""],
                "result": [*pressures[value], scores[value]],
                "low": np.nan,
                "high": np.nan,
            }
        )
        for value in pressures
    }
    change = changes_table(outcomes).set_index(["value", "output", "patch"]).change
    assert change["10", "pressure_MPa", "1"] == -10.0
    assert change["30", "gain(mcc)", ""] == pytest.approx(0.1)
    assert (change[""] == 0).all()
    # 10 + 10 and 8 + 4 of 40 MPa: what one loses and another gains does not cancel
    for value, share in (("10", 0.5), ("30", 0.3)):
        assert change[value, "relative_change(pressure_MPa)", ""] == pytest.approx(share)
