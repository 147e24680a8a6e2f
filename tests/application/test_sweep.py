"""Settings of a sweep, and the table of what comes out of them."""

import numpy as np
import pandas as pd
import pytest
from gst.sweep import STUDY, merged, sweep_settings, sweep_table

BOTH = {"material": {"young_1_MPa": 5.0, "young_2_MPa": 5.0}, "hardness": None}
VALUES = [{"macroscale": {"target_pressure_MPa": value}} for value in (10.0, 30.0)]
SETTINGS = sweep_settings({"the pressure": VALUES, "both": [BOTH]})


def test_settings_have_names_and_words():
    names = [STUDY, "the_pressure-1", "the_pressure-2", "both-1"]
    assert [setting.name for setting in SETTINGS] == names
    assert [setting.value for setting in SETTINGS] == ["", "10", "30", "5, unset"]


def test_merged_replaces_what_is_stated_and_nothing_else():
    config = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merged(config, {"a": {"b": {"e": 3}}}) == {"a": {"b": {"e": 3}, "c": 2}, "d": [1, 2]}
    assert config == {"a": {"b": 1, "c": 2}, "d": [1, 2]}


def test_changes_are_those_from_the_study():
    names, score = ["pressure_MPa", "pressure_MPa", "gain(mcc)"], [0.2, 0.1, 0.3, 0.2]
    pressures = [[30.0, 10.0], [20.0, 0.0], [38.0, 14.0], [26.0, 14.0]]
    found = {
        setting.name: pd.DataFrame({"output": names, "patch": ["1", "2", ""], "result": [*p, s]})
        for setting, p, s in zip(SETTINGS, pressures, score, strict=True)
    }
    found = {name: table.assign(low=np.nan, high=np.nan) for name, table in found.items()}
    change = sweep_table(SETTINGS, found).set_index(["value", "output", "patch"]).change
    assert change["10", "pressure_MPa", "1"] == -10.0
    assert change["30", "gain(mcc)", ""] == pytest.approx(0.1)
    assert (change[""] == 0).all()
    # 10 + 10, 8 + 4 and 4 + 4 of 40 MPa: what one loses and another gains does not cancel
    for value, share in (("10", 0.5), ("30", 0.3), ("5, unset", 0.2)):
        assert change[value, "relative_change(pressure_MPa)", ""] == pytest.approx(share)
