"""Settings of a sweep, and the table of what comes out of them, on cases made by hand."""

import copy

import numpy as np
import pandas as pd
import pytest

from gstlib.figures import sweep_figure
from gstlib.sweep.factors import STUDY, merged, sweep_settings
from gstlib.sweep.table import sweep_table

SWEEP = {
    "target pressure": [
        {"macroscale": {"target_pressure_MPa": 10.0}},
        {"macroscale": {"target_pressure_MPa": 30.0}},
    ],
    "both": [{"material": {"young_1_MPa": 5.0, "young_2_MPa": 5.0}, "texture": {"x": None}}],
}


def outcomes(pressures, score):
    rows = [("pressure_MPa", patch, value) for patch, value in zip("12", pressures, strict=True)]
    rows += [("gain(f1)", "", score)]
    return pd.DataFrame(rows, columns=["output", "patch", "result"]).assign(low=np.nan, high=np.nan)


@pytest.fixture
def table():
    return sweep_table(
        sweep_settings(SWEEP),
        {
            STUDY: outcomes([30.0, 10.0], 0.2).assign(low=0.1, high=0.4),
            "target_pressure-1": outcomes([20.0, 0.0], 0.1),
            "target_pressure-2": outcomes([38.0, 14.0], 0.3),
            "both-1": outcomes([26.0, 14.0], 0.2),
        },
    )


def test_settings_have_names_and_words():
    settings = sweep_settings(SWEEP)
    assert [setting.name for setting in settings] == [
        *(STUDY, "target_pressure-1", "target_pressure-2", "both-1")
    ]
    assert [setting.value for setting in settings] == ["", "10", "30", "5, unset"]


def test_merged_replaces_what_is_stated_and_nothing_else():
    config = {"a": {"b": {"c": 1, "d": 2}, "e": None}, "f": [1, 2]}
    before = copy.deepcopy(config)
    changed = merged(config, {"a": {"b": {"d": 3}, "e": {"new": 1}}, "f": [3]})
    assert changed == {"a": {"b": {"c": 1, "d": 3}, "e": {"new": 1}}, "f": [3]}
    assert config == before


def test_changes_are_told_from_the_study(table):
    def change(value, output, patch=""):
        rows = table[(table.value == value) & (table.output == output) & (table.patch == patch)]
        return rows.change.item()

    assert change("10", "pressure_MPa", "1") == -10.0
    assert change("30", "gain(f1)") == pytest.approx(0.1)
    assert (table.change[table.factor == ""] == 0).all()
    # 10 + 10, 8 + 4 and 4 + 4 of 40 MPa: what one loses and another gains does not cancel
    for value, share in (("10", 0.5), ("30", 0.3), ("5, unset", 0.2)):
        assert change(value, "relative_change(pressure_MPa)") == pytest.approx(share)


def test_what_moves_a_result_most_stands_on_top(table):
    before = table.copy()
    figure = sweep_figure(table, source_note="made by hand")
    pressures, gain = figure.axes

    def names(axes):
        return [label.get_text() for label in axes.get_yticklabels()]

    assert names(pressures) == ["target pressure", "both"]
    assert names(gain) == ["target pressure"]  # the other one changes nothing
    assert sorted(bar.get_width() for bar in gain.patches[1:]) == pytest.approx([-0.1, 0.1])
    pd.testing.assert_frame_equal(table, before)
