"""Over the patches: the prediction beside baselines, chance, untouched patches, a stated claim."""

import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import written

from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.summary import (
    _RANKED,
    patch_statistics,
    statistic_names,
    summarise,
)

PATCHES = list("85123467")
MODELS = ("archard", *BASELINES, ORACLE)
TOUCH = "", "spearman(touched, mean_wear_depth_um)"


def wear_of(**means):
    """Rows of ``wear.csv``: MCC about a mean for each model, on patches that are easy or hard."""
    rng = np.random.default_rng(3)
    hard, measured = rng.normal(0, 0.2, 8), 1e5 * rng.uniform(1, 3, 8)
    tables = []
    for model, mean in (dict.fromkeys(MODELS, 0.1) | means).items():
        table = pd.DataFrame({"patch": PATCHES, "model": model, "attainable_mcc": 0.9})
        table["mcc"] = mean + hard + rng.normal(0, 0.02, 8)
        table["map_error_um"] = table["out_of_contact_um"] = 1 - mean
        table["measured_volume_um3"] = measured
        table["predicted_volume_um3"] = measured * (2 - mean)
        tables.append(table)
    return pd.concat(tables)


def summary(wear, nulls=(), interlayer=None, expected=(), **changed):
    """Patches in a row, worst worn first."""
    places = {"x_mm": np.arange(8) % 3, "y_mm": np.arange(8) // 3}
    statistics = pd.DataFrame({"patch": PATCHES} | places)
    falling = dict.fromkeys(_RANKED, np.arange(8, 0, -1.0))
    statistics = statistics.assign(in_statistics=True, above_noise=True, touched=1.0)
    statistics = statistics.assign(**falling).assign(**changed)
    settings = {"seed": 1, "resamples": 499, "expected_most_worn": expected}
    table = summarise(statistics, wear, dict(nulls), interlayer, **settings)
    return table.set_index(["model", statistic_names(table)])


def test_the_gain_is_over_the_best_baseline_and_paired():
    wear = wear_of(archard=0.5, rigid=0.4, mean_volume=0.35)
    rows = summary(wear)
    row = rows.loc["archard", "gain(mcc)"]
    assert (row.against, row.value) == ("rigid", pytest.approx(0.1, abs=0.02))
    # the difference of two patches does not blur that of model and baseline
    assert 0.05 < row.low < row.value < row.high
    # exact: 2 of the 2⁸ ways to exchange model and baseline
    assert row.p_value == pytest.approx(2 / 2**8)
    for model, mean in wear.groupby("model").mcc.mean().items():
        assert rows.value[model, "mean(mcc)"] == pytest.approx(mean)


def test_a_baseline_that_is_better_was_chosen_among_five():
    row = summary(wear_of(archard=0.3, rigid=0.5)).loc["archard", "gain(mcc)"]
    assert row.high < 0
    assert row.p_value == pytest.approx(5 * 2 / 2**8)


def test_a_single_patch_is_not_tested_against_baselines():
    wear = wear_of(archard=0.3, rigid=0.5)
    row = summary(wear[wear.patch == PATCHES[0]]).loc["archard", "gain(mcc)"]
    assert row.value < 0
    assert np.isnan(row.p_value)


def test_errors_are_over_those_of_no_loss_and_of_the_best_baseline():
    rows = summary(wear_of(archard=0.8, none=0.0, pressure_volume=0.6)).loc["archard"]
    expected = {
        "relative(map_error)": (0.2, "none"),
        "relative(volume_error)": (0.5, "pressure_volume"),
        "relative_to_best(map_error)": (0.5, "pressure_volume"),
    }
    for name, (value, against) in expected.items():
        row = rows.loc[name]
        assert (row.value, row.against) == (pytest.approx(value), against)
        assert row.p_value == pytest.approx(2 / 2**8)


def test_patches_that_each_say_little_say_much_together():
    values = np.array([0.11, 0.13, 0.1, 0.12, 0.15, 0.09, 0.1, 0.12])
    nulls = np.column_stack([values, np.random.default_rng(0).normal(0, 0.1, (8, 199))])
    # the mean that is printed is that of the patches that are tested
    together, two = (
        summary(wear_of(), zip(tested, nulls, strict=False)).loc[
            "archard", "tested_mean(mcc)"
        ]
        for tested in (PATCHES, "85")
    )
    assert together.value == pytest.approx(values.mean())
    assert together.low < together.value < together.high
    assert together.p_value < 0.01
    assert (two.value, two.n) == (pytest.approx(0.12), 2)


def test_a_patch_that_does_not_count_counts_nowhere_but_among_the_untouched():
    last = np.arange(8) == 7
    rows = summary(wear_of(), in_statistics=~last, touched=1.0 * (np.arange(8) < 6))
    assert set(rows.drop(index=[TOUCH, ("archard", "tested_mean(mcc)")]).n) == {7}
    assert rows.n[TOUCH] == 8
    assert rows.value[TOUCH] > 0.5
    assert summary(wear_of(), above_noise=~last).n[TOUCH] == 7


@pytest.mark.parametrize(("error", "is_told"), [(0.99, False), (0.5, True)])
def test_an_interlayer_that_saves_a_hundredth_of_the_error_is_not_told(error, is_told):
    """Errors of measurement let an interlayer gain as much on stones that never saw one."""
    misfit = np.repeat([[1.0, 3.0, 4.0], [4.0, 3.0, 1.0]], 4, axis=0)
    interlayer = xr.Dataset(
        {"misfit": (("patch", "ratio"), misfit), "ratio_of_all": 0.3},
        coords={"patch": PATCHES, "ratio": [0.0, 0.3, 1.0]},
    )
    rows = summary(wear_of(archard=0.0, interlayer=1 - error), interlayer=interlayer)
    row = rows.loc["interlayer", "relative(out_of_contact)"]
    assert (row.value, row.against) == (pytest.approx(error / 0.98), "archard")
    assert (row.value < 1 and row.p_value < 0.05) == is_told
    # half of the patches say that there was none, half that it did most
    row = rows.loc["interlayer", "interlayer_ratio"]
    assert (row.value, row.low, row.high) == (0.3, 0, 1)


@pytest.mark.parametrize(
    ("fractions", "value", "p_value"),
    [
        ([8, 7, 6, 5, 4, 3, 2, 1], 1, 1 / 28),
        ([8, 6, 7, 5, 4, 3, 2, 1], 0.5, 13 / 28),
        ([1, 2, 6, 5, 4, 3, 7, 8], 0, 1),
        # a tie counts against the claim
        ([8, 7, 7, 5, 4, 3, 2, 1], 0.5, 13 / 28),
        # of a patch without a value there is none
        ([math.nan, 7, 6, 5, 4, 3, 2, 1], math.nan, math.nan),
    ],
)
def test_the_papers_claim_is_exact(fractions, value, p_value):
    rows = summary(
        pd.DataFrame(), expected=["5", "8"], loss_fraction=np.array(fractions, float)
    )
    row = rows.loc["", "expected_most_worn(5+8, loss_fraction)"]
    assert row.against == "random ranking"
    assert [row.value, row.p_value] == pytest.approx([value, p_value], nan_ok=True)


def test_statistics_are_of_the_use_as_stated_also_without_a_prediction():
    """A use that was read from the wear says nothing of its cause."""
    pressures = written(
        """
        patch, x_mm, y_mm, in_study, pressure_MPa, stated_MPa, leave_one_out_MPa
        a,     1,    2,    True,     0,            3,          7
        b,     1,    2,    True,     5,            0,          7
        c,     1,    2,    True,     1,            0,          7
        """
    )
    registration = written(
        """
        patch, loss_fraction, mean_wear_depth_um, known_fraction, above_noise
        b,     0.1,           0.3,                1,              False
        a,     0.2,           0.4,                1,              True
        c,     ,              ,                   0,              False
        """
    )
    patches = pressures[["patch"]].assign(contact_fraction=0.1, predicted_loss_um=0.2)
    table = patch_statistics(patches, registration, pressures).set_index("patch")
    assert table.touched.to_dict() == {"a": 1.0, "b": 0.0}  # of c nothing is known
    assert table.pressure_MPa.tolist() == [3.0, 0.0]
    assert table.mean_wear_depth_um.tolist() == [0.4, 0.3]
    assert table.in_statistics.tolist() == [True, False]
    alone = patch_statistics(patches[:0], registration, pressures)
    assert alone.predicted_loss_um.isna().all()
    assert alone.touched.tolist() == [1.0, 0.0]
