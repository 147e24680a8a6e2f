"""Over the patches: rank correlations, means against chance and rivals, and a stated claim."""

import math
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kendalltau, spearmanr

from gstlib.validation.across import (
    SUMMARY_COLUMNS,
    expected_worst,
    mean_gains,
    mean_recalls,
    mean_scores,
    rank_correlations,
)
from gstlib.validation.scores import SCORES

PAIR = {"predictors": ["pressure_MPa"], "extents": ["loss_fraction"]}


def chance(seed=0, **changed):
    return {"generator": np.random.default_rng(seed), "resamples": 999} | changed


def table(seed=0, n=8):
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {
            "patch": [str(number) for number in range(1, n + 1)],
            "pressure_MPa": rng.permutation(n) * 10.0,
            "contact_fraction": rng.random(n),
            "stiffness_MPa_per_um": rng.random(n),
            "loss_fraction": rng.random(n),
            "loss_per_area_um": rng.random(n),
        }
    )


def test_rank_correlations_of_a_monotone_relation():
    data = table()
    data["loss_fraction"] = np.exp(data["pressure_MPa"] / 30)
    result = rank_correlations(data, **chance())
    assert list(result.columns) == SUMMARY_COLUMNS
    assert len(result) == 3 * 2 * 2
    for row, name in zip(result.iloc[:2].itertuples(), ("spearman", "kendall"), strict=True):
        assert row.statistic == f"{name}(pressure_MPa, loss_fraction)"
        assert row.value == pytest.approx(1)
        assert row.n == 8
        # exact: 2 of the 8! pairings are as extreme
        assert row.p_value == pytest.approx(2 / math.factorial(8))
        assert row.low == pytest.approx(1)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 50))
def test_rank_correlations_agree_with_scipy(seed):
    data = table(seed, n=6)
    data["loss_per_area_um"] = data["loss_per_area_um"].round(1)  # with ties, now and then
    result = rank_correlations(
        data, predictors=["contact_fraction"], extents=["loss_per_area_um"], **chance()
    )
    x, y = data["contact_fraction"], data["loss_per_area_um"]
    assert result["value"].iloc[0] == pytest.approx(spearmanr(x, y).statistic)
    assert result["value"].iloc[1] == pytest.approx(kendalltau(x, y).statistic)
    if y.is_unique:
        assert result["p_value"].iloc[1] == pytest.approx(kendalltau(x, y, method="exact").pvalue)
    assert (result["low"] <= result["high"]).all()


def test_of_a_few_patches_there_is_a_value_but_no_interval():
    result = rank_correlations(table(n=5), **PAIR, **chance())
    assert result["value"].notna().all()
    assert result["low"].isna().all()


def test_interval_lies_around_a_middling_correlation():
    data = table(n=12)
    data["loss_fraction"] = data["pressure_MPa"] + 40 * data["loss_fraction"]
    first = rank_correlations(data, **PAIR, **chance()).iloc[0]
    assert 0.5 < first["value"] < 0.98
    assert 0 < first["low"] < first["value"] < first["high"] <= 1
    assert 0 < first["p_value"] < 0.05


def test_same_seed_same_table():
    runs = [rank_correlations(table(n=12), **chance(5)) for _ in range(2)]
    pd.testing.assert_frame_equal(*runs)
    assert not rank_correlations(table(n=12), **chance(6)).equals(runs[0])


def test_too_few_or_constant_is_missing_not_wrong():
    data = table()
    data["contact_fraction"] = 0.1
    data.loc[2:, "loss_fraction"] = np.nan
    result = rank_correlations(data, predictors=["pressure_MPa", "contact_fraction"], **chance())
    spearman = result[result["statistic"].str.startswith("spearman")]
    assert list(spearman["n"]) == [2, 8, 2, 8]
    assert list(spearman["value"].isna()) == [True, False, True, True]


def weighed(values):
    """The gains table of patches that all scores rate the same."""
    return pd.DataFrame(
        [
            {"patch": str(number), "score": score, "value": value, "p_value": value}
            for number, value in enumerate(values)
            for score in SCORES
        ]
    )


def nulls(rng, values, shifts=999):
    return [{s: np.r_[value, rng.normal(0, 0.1, shifts)] for s in SCORES} for value in values]


def test_patches_that_each_say_little_say_much_together():
    rng = np.random.default_rng(0)
    values = [0.11, 0.13, 0.1, 0.12, 0.15, 0.09]
    row = mean_scores(weighed(values), nulls(rng, values), **chance()).set_index("statistic")
    found = row.loc["mean(mcc)"]
    assert found["value"] == pytest.approx(np.mean(values))
    assert found["low"] < found["value"] < found["high"]
    assert found["p_value"] < 0.01
    alone = mean_scores(weighed(values[:1]), nulls(rng, values[:1]), **chance())
    assert alone["p_value"].min() > 0.05
    assert alone["low"].isna().all()


def test_mean_score_is_above_chance_as_often_as_the_level_says():
    rng = np.random.default_rng(1)
    p_values = []
    for _ in range(150):
        values = rng.normal(0, 0.1, 5)
        found = mean_scores(weighed(values), nulls(rng, values, 199), **chance(resamples=99))
        p_values.append(found["p_value"].iloc[0])
    assert np.mean(np.array(p_values) <= 0.1) == pytest.approx(0.1, abs=0.06)


def test_a_patch_without_the_score_is_left_out_and_the_shortest_null_rules():
    rng = np.random.default_rng(2)
    values = [0.3, math.nan, 0.5]
    null = nulls(rng, values)
    null[2] = {score: drawn[:100] for score, drawn in null[2].items()}
    found = mean_scores(weighed(values), null, **chance()).iloc[0]
    assert (found["n"], found["value"]) == (2, pytest.approx(0.4))
    assert found["p_value"] == pytest.approx(1 / 100)


def scored(rng, n=8, model=0.3, highest=0.4, rigid=0.35):
    patch = rng.normal(0, 0.2, n)  # what makes a patch easy or hard for all of them
    columns = {"": model, "highest_": highest, "rigid_": rigid}
    data = {f"{front}f1": mean + patch + rng.normal(0, 0.02, n) for front, mean in columns.items()}
    return pd.DataFrame(data | {"roc_auc": patch, "highest_roc_auc": patch})


def gain_rows(data):
    for score in SCORES:
        if score not in data:
            data = data.assign(**{score: math.nan, f"highest_{score}": math.nan})
    return mean_gains(data, ["highest", "rigid"], **chance()).set_index("statistic")


def test_gain_is_over_the_best_rival_and_paired():
    found = gain_rows(scored(np.random.default_rng(3)))
    row = found.loc["gain(f1)"]
    assert row["against"] == "highest"
    assert row["value"] == pytest.approx(-0.1, abs=0.02)
    # the difference of two patches does not blur that of model and rival
    assert row["low"] < row["value"] < row["high"] < -0.05
    # exact: 2 of the 2⁸ ways to exchange model and rival
    assert row["p_value"] == pytest.approx(2 / 2**8)
    same = found.loc["gain(roc_auc)"]
    assert (same["value"], same["low"], same["high"]) == (0, 0, 0)
    assert math.isnan(same["p_value"])
    assert found.loc["gain(mcc)", "n"] == 0


def test_no_gain_is_claimed_where_there_is_none_more_often_than_the_level_says():
    """Also not where two rivals are as good as the model, and the luckier one is the best."""
    rng = np.random.default_rng(4)
    claims = losses = 0
    for _ in range(120):
        row = gain_rows(scored(rng, model=0.4, highest=0.4, rigid=0.4)).loc["gain(f1)"]
        claims += row["low"] > 0
        losses += row["high"] < 0
    assert claims / 120 < 0.05
    assert losses / 120 < 0.15


def failures():
    bands = [("height", "0-50 %", 0.2, 0.0), ("height", "50-100 %", 0.8, 0.5)]
    bands += [("gap", "contact", 0.4, 1.0), ("gap", "over 1 um", 0.6, 0.0)]
    return pd.DataFrame(
        [
            {"patch": patch, "split": split, "band": band, "loss_share": share, "recall": recall}
            for patch in "123"
            for split, band, share, recall in bands
        ]
    )


def test_mean_recalls_by_height_and_shares_by_gap():
    found = mean_recalls(failures(), **chance()).set_index("statistic")
    assert found["value"].to_dict() == pytest.approx(
        {
            "loss_share(height 0-50 %)": 0.2,
            "recall(height 0-50 %)": 0.0,
            "loss_share(height 50-100 %)": 0.8,
            "recall(height 50-100 %)": 0.5,
            "loss_share(gap contact)": 0.4,
            "loss_share(gap over 1 um)": 0.6,
        }
    )
    assert found["p_value"].isna().all()


def worst(order, expected, **changed):
    """The claim on patches 1 to 8, worst first."""
    data = pd.DataFrame({"patch": list(order), "loss_fraction": np.arange(8, 0, -1.0)} | changed)
    return expected_worst(data, expected, ["loss_fraction"]).iloc[0]


def test_the_papers_claim_is_exact():
    both = worst("85123467", ["5", "8"])
    assert both["statistic"] == "expected_worst(5+8, loss_fraction)"
    assert both["against"] == "random ranking"
    assert both["value"] == 1
    assert both["p_value"] == pytest.approx(1 / math.comb(8, 2))
    one = worst("81523467", ["5", "8"])
    drawn = [len({0, 1} & set(pair)) for pair in combinations(range(8), 2)]
    assert (one["value"], one["p_value"]) == (0.5, pytest.approx(np.mean(np.array(drawn) >= 1)))
    none = worst("12345678", ["5", "8"])
    assert (none["value"], none["p_value"]) == (0, 1)


def test_a_tie_counts_against_the_claim():
    tied = worst("85123467", ["5", "8"], loss_fraction=[8.0, 7.0, 7.0, 5, 4, 3, 2, 1])
    assert tied["value"] == 0.5


def test_a_claim_about_patches_that_are_not_there_has_no_value():
    missing = worst("85123467", ["5", "9"])
    assert math.isnan(missing["value"])
    assert math.isnan(missing["p_value"])
    gone = worst("85123467", ["5", "8"], loss_fraction=[math.nan, *range(7, 0, -1)])
    assert math.isnan(gone["value"])
    assert gone["n"] == 7
    assert not len(expected_worst(table(), [], ["loss_fraction"]))


def test_neighbours_weaken_a_correlation_of_smooth_numbers():
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:4, :4].reshape(2, -1).astype(float)
    table = pd.DataFrame(
        {
            "pressure_MPa": x + 0.3 * rng.standard_normal(16),
            "loss_fraction": x + 0.3 * rng.standard_normal(16),
            "x_mm": x,
            "y_mm": y,
        }
    )
    chance = {"predictors": ["pressure_MPa"], "extents": ["loss_fraction"], "resamples": 99}
    plain, allowed = (
        rank_correlations(table, generator=np.random.default_rng(1), places=places, **chance)
        for places in (None, ("x_mm", "y_mm"))
    )
    assert list(allowed.against) == ["other pairings, neighbours alike", "other pairings"]
    assert allowed.p_value[0] > plain.p_value[0]
    pd.testing.assert_frame_equal(
        plain.drop(columns=["p_value", "against"]), allowed.drop(columns=["p_value", "against"])
    )
