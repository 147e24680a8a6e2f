"""Over the patches: the prediction beside baselines, chance, untouched patches, a stated claim."""

import math
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.inference import Draws
from gstlib.validation.summary import (
    _chance_row,
    _model_rows,
    patch_statistics,
    statistic_names,
    summarise,
)

MODELS = ("archard", *BASELINES, ORACLE)


def wear_of(patches, seed=3, **means):
    """Rows of ``wear.csv``: MCC about a mean for each model, on patches that are easy or hard."""
    rng = np.random.default_rng(seed)
    hard, measured = rng.normal(0, 0.2, len(patches)), 1e5 * rng.uniform(1, 3, len(patches))
    rows = []
    for model in (*MODELS, *(name for name in means if name not in MODELS)):
        mcc = means.get(model, 0.1) + hard + rng.normal(0, 0.02, len(patches))
        for number, patch in enumerate(patches):
            error = 1.0 - means.get(model, 0.1)
            rows.append(
                {"patch": patch, "model": model, "mcc": mcc[number], "attainable_mcc": 0.9}
                | {"predicted_volume_um3": measured[number] * (1 + error)}
                | {"measured_volume_um3": measured[number], "predicted_worn_fraction": 0.1}
                | {"map_error_um": error, "out_of_contact_um": error}
            )
    return pd.DataFrame(rows)


def statistics_of(patches, **changed):
    """Patches in a row, worst worn first."""
    count = len(patches)
    falling = np.arange(count, 0, -1.0)
    table = {
        "patch": list(patches),
        "x_mm": np.arange(count) % 3.0,
        "y_mm": np.arange(count) // 3.0,
    }
    table |= {"in_statistics": True, "above_noise": True, "touched": 1.0}
    for name in ("pressure_MPa", "contact_fraction", "predicted_loss_um"):
        table[name] = falling
    table |= {"loss_fraction": falling, "mean_wear_depth_um": falling} | changed
    return pd.DataFrame(table)


def nulls_of(patches, values=None, draws=199):
    """Patches with an MCC each, and what chance gives."""
    rng = np.random.default_rng(0)
    values = np.full(len(patches), 0.2) if values is None else values
    return {
        patch: np.r_[value, rng.normal(0, 0.1, draws)]
        for patch, value in zip(patches, values, strict=True)
    }


def summary(patches="85123467", *, wear=None, nulls=None, interlayer=None, worst=(), **changed):
    statistics = statistics_of(patches, **changed)
    wear = wear_of(list(patches)) if wear is None else wear
    nulls = nulls_of(patches) if nulls is None else nulls
    chance = {"seed": 1, "resamples": 999}
    rows = summarise(statistics, wear, nulls, interlayer, expected_most_worn=worst, **chance)
    return rows.set_index(["model", statistic_names(rows)])


def model_rows(wear):
    """The rows about models alone: the correlations take longer."""
    draws = Draws(np.random.default_rng(1), 999)
    found = {row[:2]: row[2]._asdict() | {"against": row[3]} for row in _model_rows(wear, draws)}
    return pd.DataFrame(found).T


def test_the_gain_is_over_the_best_baseline_and_paired():
    patches = list("85123467")
    wear = wear_of(patches, archard=0.5, rigid=0.4, mean_volume=0.35)
    rows = model_rows(wear)
    row = rows.loc["archard", "gain(mcc)"]
    assert row.against == "rigid"
    assert row.value == pytest.approx(0.1, abs=0.02)
    # the difference of two patches does not blur that of model and baseline
    assert 0.05 < row.low < row.value < row.high
    # exact: 2 of the 2⁸ ways to exchange model and baseline
    assert row.p_value == pytest.approx(2 / 2**8)
    by_model = wear.groupby("model").mcc.mean()
    for model in MODELS:
        assert rows.loc[(model, "mean(mcc)"), "value"] == pytest.approx(by_model[model])
    assert rows.loc[("archard", "mean(attainable_mcc)"), "value"] == pytest.approx(0.9)


def test_a_baseline_that_is_better_was_chosen_among_five():
    wear = wear_of(list("85123467"), archard=0.3, rigid=0.5)
    row = model_rows(wear).loc["archard", "gain(mcc)"]
    assert row.high < 0
    assert row.p_value == pytest.approx(5 * 2 / 2**8)


def test_errors_are_over_those_of_no_loss_and_of_the_best_baseline():
    wear = wear_of(list("85123467"), archard=0.8, none=0.0, pressure_volume=0.6)
    rows = model_rows(wear)
    of_map = rows.loc["archard", "relative(map_error)"]
    assert (of_map.value, of_map.against) == (pytest.approx(0.2), "none")
    assert of_map.p_value == pytest.approx(2 / 2**8)
    of_volume = rows.loc["archard", "relative(volume_error)"]
    assert (of_volume.value, of_volume.against) == (pytest.approx(0.5), "pressure_volume")
    assert rows.loc[("rigid", "relative(map_error)"), "value"] == pytest.approx(0.9)
    best = summary(wear=wear).loc["archard", "relative_to_best(map_error)"]
    assert (best.value, best.against) == (pytest.approx(0.5), "pressure_volume")
    assert best.p_value == of_volume.p_value
    assert ("none", "relative(map_error)") not in rows.index


def test_no_gain_is_claimed_without_one_more_often_than_the_level_says():
    """Also not where all baselines are as good as the model, and the luckiest one is the best."""
    alike = dict.fromkeys(MODELS, 0.4)
    better = worse = 0
    for seed in range(60):
        wear = wear_of(list("85123467"), seed=seed, **alike)
        row = model_rows(wear).loc["archard", "gain(mcc)"]
        better += row.low > 0 and row.p_value <= 0.05
        worse += row.high < 0 and row.p_value <= 0.05
    assert better / 60 < 0.05
    assert worse / 60 < 0.1


def chance_row(nulls):
    *_, estimate, _ = _chance_row("archard", nulls, Draws(np.random.default_rng(1), 999))
    return estimate


def test_patches_that_each_say_little_say_much_together():
    values = np.array([0.11, 0.13, 0.1, 0.12, 0.15, 0.09, 0.1, 0.12])
    nulls = nulls_of("85123467", values)
    row = chance_row(list(nulls.values()))
    assert row.value == pytest.approx(values.mean())
    assert row.low < row.value < row.high
    assert row.p_value < 0.01
    # the mean that is printed is that of the patches that are tested and count
    few = {patch: nulls[patch] for patch in "8523"}
    counted = [patch not in "23" for patch in "85123467"]
    row = summary(nulls=few, in_statistics=counted).loc["archard", "tested_mean(mcc)"]
    assert (row.value, row.n) == (pytest.approx(0.12), 2)


def test_the_mean_is_above_chance_as_often_as_the_level_says():
    rng = np.random.default_rng(1)
    claims = [chance_row(list(rng.normal(0, 0.1, (8, 100)))).p_value <= 0.1 for _ in range(200)]
    assert np.mean(claims) == pytest.approx(0.1, abs=0.06)


def test_a_patch_that_does_not_count_counts_nowhere_but_among_the_untouched():
    counted = [True] * 7 + [False]
    rows = summary(in_statistics=counted, touched=[1.0] * 6 + [0.0] * 2)
    alone = rows.drop(index=("", "spearman(touched, mean_wear_depth_um)"))
    assert set(alone.n) == {7}
    of_touch = rows.loc["", "spearman(touched, mean_wear_depth_um)"]
    assert of_touch.n == 8
    assert of_touch.value > 0.5
    unsure = summary(above_noise=[True] * 7 + [False], touched=[1.0] * 6 + [0.0] * 2)
    assert unsure.loc[("", "spearman(touched, mean_wear_depth_um)"), "n"] == 7


def test_without_predictions_there_are_correlations_alone():
    rows = summary(wear=wear_of([]), nulls={})
    assert set(rows.index.get_level_values("model")) == {""}
    assert rows.value.notna().any()
    nothing = summarise(statistics_of(""), wear_of([]), [], None, seed=1, resamples=99)
    assert nothing.value.isna().all()


def test_an_interlayer_that_saves_a_hundredth_of_the_error_is_not_told():
    """Errors of measurement let an interlayer gain as much on stones that never saw one."""
    patches = list("85123467")
    misfit = np.tile([[2.0, 1.0, 3.0]], (8, 1))
    interlayer = xr.Dataset(
        {"misfit": (("patch", "ratio"), misfit), "ratio_of_all": 0.3},
        coords={"patch": patches, "ratio": [0.0, 0.3, 1.0]},
    )
    for error, told in ((0.99, False), (0.5, True)):
        wear = wear_of(patches, interlayer=0.1)
        wear.loc[wear.model == "archard", "out_of_contact_um"] = 1.0
        wear.loc[wear.model == "interlayer", "out_of_contact_um"] = error
        rows = summary(wear=wear, interlayer=interlayer)
        row = rows.loc["interlayer", "relative(out_of_contact)"]
        assert (row.value, row.against) == (pytest.approx(error / 0.98), "archard")
        assert (row.value < 1 and row.p_value < 0.05) == told
        assert tuple(rows.loc["interlayer", "interlayer_ratio"][["value", "low", "high"]]) == (
            0.3,
            0.3,
            0.3,
        )
    # the interval is over patches: half of them say that there was none, half that it did most
    interlayer["misfit"][:] = np.repeat([[1.0, 3.0, 4.0], [4.0, 3.0, 1.0]], 4, axis=0)
    assert tuple(
        summary(wear=wear, interlayer=interlayer).loc["interlayer", "interlayer_ratio"][
            ["low", "high"]
        ]
    ) == (0, 1)


def test_the_papers_claim_is_exact():
    claim = "", "expected_most_worn(5+8, loss_fraction)"
    both = summary(worst=["5", "8"]).loc[claim]
    assert both["against"] == "random ranking"
    assert (both["value"], both["p_value"]) == (1, pytest.approx(1 / math.comb(8, 2)))
    one = summary("81523467", worst=["5", "8"]).loc[claim]
    drawn = [len({0, 1} & set(pair)) for pair in combinations(range(8), 2)]
    assert (one["value"], one["p_value"]) == (0.5, pytest.approx(np.mean(np.array(drawn) >= 1)))
    none = summary("12345678", worst=["5", "8"]).loc[claim]
    assert (none["value"], none["p_value"]) == (0, 1)
    # a tie counts against the claim
    tied = summary(worst=["5", "8"], loss_fraction=[8.0, 7.0, 7.0, 5, 4, 3, 2, 1]).loc[claim]
    assert tied.value == 0.5
    # a claim about patches without a value has none
    missing = summary(worst=["5", "9"]).loc["", "expected_most_worn(5+9, loss_fraction)"]
    gone = summary(worst=["5", "8"], loss_fraction=[math.nan, 7, 6, 5, 4, 3, 2, 1]).loc[claim]
    assert np.isnan([missing.value, missing.p_value, gone.value]).all()
    assert gone.n == 7


def test_statistics_come_from_the_tables_of_each_patch_also_without_a_prediction():
    patches = pd.DataFrame({"patch": ["a", "b"], "contact_fraction": 0.1, "predicted_loss_um": 0.2})
    registration = pd.DataFrame({"patch": ["b", "a", "c"], "loss_fraction": [0.1, 0.2, np.nan]})
    registration = registration.assign(
        mean_wear_depth_um=[0.3, 0.4, np.nan], known_fraction=[1, 1, 0]
    )
    registration["above_noise"] = [False, True, False]
    pressures = pd.DataFrame({"patch": ["a", "b", "c"], "x_mm": 1.0, "y_mm": 2.0, "in_study": True})
    pressures["pressure_MPa"] = [0.0, 5.0, 1.0]
    table = patch_statistics(patches, registration, pressures).set_index("patch")
    assert table.touched.to_dict() == {"a": 0.0, "b": 1.0}  # of c nothing is known
    assert table.mean_wear_depth_um.tolist() == [0.4, 0.3]
    assert table.in_statistics.tolist() == [True, False]
    # of a use that was read from the wear, pressure and touch say nothing of its cause
    shaped = pressures.assign(stated_MPa=[3.0, 0.0, 0.0], leave_one_out_MPa=7.0)
    stated = patch_statistics(patches, registration, shaped).set_index("patch")
    assert stated.touched.to_dict() == {"a": 1.0, "b": 0.0}
    assert stated.pressure_MPa.to_dict() == {"a": 3.0, "b": 0.0}
    alone = patch_statistics(patches[:0], registration, pressures)
    assert alone.predicted_loss_um.isna().all()
    assert alone.touched.tolist() == [0.0, 1.0]
