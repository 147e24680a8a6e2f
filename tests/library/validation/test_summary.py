"""Over the patches: rank correlations, means against chance and rivals, and a stated claim."""

import math
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from gstlib.validation.scores import SCORES
from gstlib.validation.scoring import PatchScores
from gstlib.validation.summary import (
    mean_gains,
    mean_scores,
    rank_correlation,
    spatial_p_value,
    summarise,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import spearmanr

PAIR = "pressure_MPa", "loss_fraction"


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


def test_rank_correlation_agrees_with_scipy():
    data = table()
    data["loss_per_area_um"] = data["loss_per_area_um"].round(1)  # with ties
    data["loss_fraction"] = np.exp(data["pressure_MPa"] / 30)
    tied = rank_correlation(data, "contact_fraction", "loss_per_area_um", **chance()).iloc[0]
    expected = spearmanr(data["contact_fraction"], data["loss_per_area_um"]).statistic
    assert tied["value"] == pytest.approx(expected)
    row = rank_correlation(data, *PAIR, **chance()).iloc[0]
    assert row.statistic == "spearman(pressure_MPa, loss_fraction)"
    assert (row.value, row.low, row.n) == (pytest.approx(1), pytest.approx(1), 8)
    # exact: 2 of the 8! pairings are as extreme
    assert row.p_value == pytest.approx(2 / math.factorial(8))


def test_interval_encloses_a_middling_correlation():
    data = table(n=12)
    data["loss_fraction"] = data["pressure_MPa"] + 40 * data["loss_fraction"]
    row = rank_correlation(data, *PAIR, **chance()).iloc[0]
    assert 0.5 < row["value"] < 0.98
    assert 0 < row["low"] < row["value"] < row["high"] <= 1
    assert 0 < row["p_value"] < 0.05


@pytest.mark.parametrize(("known", "column"), [(5, "x"), (2, "x"), (8, "constant")])
def test_too_few_or_constant_is_missing_not_wrong(known, column):
    data = table().assign(constant=0.1).rename(columns={"pressure_MPa": "x"})
    data.loc[known:, "loss_fraction"] = np.nan
    row = rank_correlation(data, column, "loss_fraction", **chance()).iloc[0]
    assert row["n"] == known
    assert np.isfinite(row["value"]) == (known == 5)
    assert np.isnan(row["low"])  # of five patches there is a value, but no interval


def patches(rng, values, shifts=999):
    """Patches that all scores rate the same, with their nulls."""
    return [
        PatchScores(
            scores=dict.fromkeys(SCORES, value) | {"patch": str(number), "believed": True},
            gains=[{"score": score, "value": value, "p_value": value} for score in SCORES],
            null={score: np.r_[value, rng.normal(0, 0.1, shifts)] for score in SCORES},
            warning=None,
        )
        for number, value in enumerate(values)
    ]


def test_patches_that_each_say_little_say_much_together():
    rng = np.random.default_rng(0)
    values = [0.11, 0.13, 0.1, 0.12, 0.15, 0.09]
    found = mean_scores(patches(rng, values), **chance()).set_index("statistic").loc["mean(mcc)"]
    assert found["value"] == pytest.approx(np.mean(values))
    assert found["low"] < found["value"] < found["high"]
    assert found["p_value"] < 0.01
    alone = mean_scores(patches(rng, values[:1]), **chance())
    assert alone["p_value"].min() > 0.05
    assert alone["low"].isna().all()


def test_mean_score_is_above_chance_as_often_as_the_level_says():
    rng = np.random.default_rng(1)
    p_values = []
    for _ in range(150):
        found = mean_scores(patches(rng, rng.normal(0, 0.1, 5), 199), **chance(resamples=99))
        p_values.append(found["p_value"].iloc[0])
    assert np.mean(np.array(p_values) <= 0.1) == pytest.approx(0.1, abs=0.06)


def test_a_patch_without_the_score_is_left_out_and_the_shortest_null_counts():
    found = patches(np.random.default_rng(2), [0.3, math.nan, 0.5])
    found[2].null.update({score: drawn[:100] for score, drawn in found[2].null.items()})
    row = mean_scores(found, **chance()).iloc[0]
    assert (row["n"], row["value"]) == (2, pytest.approx(0.4))
    assert row["p_value"] == pytest.approx(1 / 100)


def scored(rng, n=8, model=0.3, highest=0.4, rigid=0.35):
    patch = rng.normal(0, 0.2, n)  # makes a patch easy or hard for all of them
    columns = {"": model, "highest_": highest, "rigid_": rigid}
    data = {f"{front}f1": mean + patch + rng.normal(0, 0.02, n) for front, mean in columns.items()}
    return pd.DataFrame(data | {"roc_auc": patch, "highest_roc_auc": patch})


def gain_rows(data):
    missing = [name for score in SCORES for name in (score, f"highest_{score}") if name not in data]
    found = mean_gains(data.assign(**dict.fromkeys(missing, math.nan)), **chance())
    return found.set_index("statistic")


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


def test_no_gain_is_claimed_without_one_more_often_than_the_level_says():
    """Also not where two rivals are as good as the model, and the luckier one is the best."""
    rng = np.random.default_rng(4)
    claims = losses = 0
    for _ in range(120):
        row = gain_rows(scored(rng, model=0.4, highest=0.4, rigid=0.4)).loc["gain(f1)"]
        claims += row["low"] > 0
        losses += row["high"] < 0
    assert claims / 120 < 0.05
    assert losses / 120 < 0.15


def study(order="85123467"):
    """Eight patches, worst first; their scores and their places."""
    found = []
    for number, one in enumerate(patches(np.random.default_rng(5), [0.2] * len(order))):
        loss = 8.0 - number
        names = {"patch": order[number], "loss_fraction": loss, "loss_per_area_um": loss}
        scores = dict.fromkeys((f"{front}{s}" for front in ("", "highest_") for s in SCORES), 0.2)
        one.scores.update(scores | names | {"contact_fraction": loss})
        found.append(one)
    predicted = pd.DataFrame(
        {"patch": list(order), "x_mm": np.arange(8.0) % 3, "y_mm": np.arange(8.0) // 3}
        | {"pressure_MPa": np.arange(8.0, 0, -1), "stiffness_MPa_per_um": 1.0}
    )
    return found, predicted


def summary(order="85123467", worst=("5", "8"), loss=None):
    found, predicted = study(order)
    for one, value in zip(found, loss or [], strict=False):
        one.scores["loss_fraction"] = value
    # patches may come in any order
    predicted = predicted[::-1].reset_index(drop=True)
    chance = {"seed": 1, "resamples": 99}
    rows, _ = summarise({"placed": found}, predicted, expected_worst=worst, **chance)
    return rows.set_index("statistic")


def test_summary_of_a_study():
    found = summary(worst=())
    kinds = found.index.str.partition("(").get_level_values(0).value_counts().to_dict()
    assert kinds == {"mean": 7, "spearman": 6}
    pair = found.loc["spearman(pressure_MPa, loss_fraction)"]
    assert pair["value"] == pytest.approx(1)
    assert pair["against"] == "other pairings, neighbours alike"
    assert pd.isna(found.loc["spearman(stiffness_MPa_per_um, loss_fraction)", "value"])
    assert "spearman(exposure_N_per_mm, loss_fraction)" not in found.index  # there is no gesture
    assert found.loc["mean(f1)", "p_value"] < 0.01
    # without patches the table has its columns and no rows
    chance = {"seed": 1, "resamples": 99}
    empty, variants = summarise({"placed": []}, study()[1], expected_worst=["5"], **chance)
    assert (list(empty), len(empty)) == ([*found.reset_index()], 0)
    assert set(variants.n) == {0}


def test_the_variants_are_scored_alike():
    """Each as if it were alone; the summary is that of the first."""
    found, predicted = study()
    chance = {"seed": 1, "resamples": 99}
    for number, one in enumerate(found):
        one.scores["highest_f1"] = number / 10
    other = found[:6]
    both, rows = summarise({"placed": found, "levelled": other}, predicted, **chance)
    alone, own = summarise({"placed": found}, predicted, **chance)
    _, rest = summarise({"levelled": other}, predicted, **chance)
    pd.testing.assert_frame_equal(both, alone)
    pd.testing.assert_frame_equal(rows, pd.concat([own, rest], ignore_index=True))


def test_a_patch_whose_loss_may_be_noise_counts_nowhere():
    """One number of patches in the whole table, and in that of the variants."""
    found, predicted = study()
    found[2].scores["believed"] = False
    chance = {"seed": 1, "resamples": 99}
    rows, variants = summarise({"placed": found}, predicted, **chance)
    assert set(rows.n[rows.value.notna()]) == {7}
    assert set(variants.n[variants.gain.notna()]) == {7}
    assert len(summarise({"placed": found[2:3]}, predicted, **chance)[0]) == 0


def test_the_papers_claim_is_exact():
    claim = "expected_worst(5+8, loss_fraction)"
    both = summary().loc[claim]
    assert both["against"] == "random ranking"
    assert (both["value"], both["p_value"]) == (1, pytest.approx(1 / math.comb(8, 2)))
    one = summary("81523467").loc[claim]
    drawn = [len({0, 1} & set(pair)) for pair in combinations(range(8), 2)]
    assert (one["value"], one["p_value"]) == (0.5, pytest.approx(np.mean(np.array(drawn) >= 1)))
    none = summary("12345678").loc[claim]
    assert (none["value"], none["p_value"]) == (0, 1)
    # a tie counts against the claim
    assert summary(loss=[8.0, 7.0, 7.0]).loc[claim, "value"] == 0.5

    # a claim about patches without a value has none
    missing = summary(worst=["5", "9"]).loc["expected_worst(5+9, loss_fraction)"]
    gone = summary(loss=[math.nan]).loc[claim]
    assert np.isnan([missing["value"], missing["p_value"], gone["value"]]).all()
    assert gone["n"] == 7


SIDE = 5
PLACES = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
LEVEL, PAIRS = 0.05, 400


def fields(length, seed):
    """Gaussian fields on the patches, correlated over `length`: (PAIRS, 2, patches)."""
    distance = np.hypot(*(PLACES[:, None] - PLACES).transpose(2, 0, 1))
    factor = np.linalg.cholesky(np.exp(-((distance / length) ** 2)) + 1e-9 * np.eye(len(PLACES)))
    return np.random.default_rng(seed).standard_normal((PAIRS, 2, len(PLACES))) @ factor.T


def test_smooth_unrelated_fields_are_significant_as_often_as_the_level_says():
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / PAIRS)
    plain, spatial = [], []
    for x, y in fields(1.2, seed=1):
        plain.append(spearmanr(x, y).pvalue)
        spatial.append(spatial_p_value(x, y, PLACES, permuted=plain[-1]))
    assert np.mean(np.less_equal(plain, LEVEL)) > LEVEL + error  # neighbours pass for evidence
    assert abs(np.mean(np.less_equal(spatial, LEVEL)) - LEVEL) < error


def test_spatial_autocorrelation_weakens_a_correlation_of_smooth_numbers():
    rng = np.random.default_rng(8)
    y, x = np.mgrid[:4, :4].reshape(2, -1).astype(float)
    data = pd.DataFrame({"x_mm": x, "y_mm": y})
    for name in ("pressure_MPa", "loss_fraction"):
        data[name] = x + 0.3 * rng.standard_normal(16)
    plain, spatial = (
        rank_correlation(data, *PAIR, places=places, **chance(1, resamples=99))
        for places in ((), ("x_mm", "y_mm"))
    )
    assert list(spatial.against) == ["other pairings, neighbours alike"]
    assert spatial.p_value[0] > plain.p_value[0]
    changed = ["p_value", "against"]
    pd.testing.assert_frame_equal(plain.drop(columns=changed), spatial.drop(columns=changed))


def test_the_permutation_test_bounds_the_spatial_p_value():
    x = fields(1.0, seed=4)[0, 0]
    assert spatial_p_value(x, np.exp(x), PLACES, permuted=1e-9) == 1e-9
    four = np.arange(4.0)
    assert spatial_p_value(four, four, PLACES[:4], permuted=2 / 24) == 2 / 24
    for y in (np.zeros(4), np.arange(3.0)):  # no spread, or too few patches
        assert np.isnan(spatial_p_value(four[: len(y)], y, PLACES[: len(y)], permuted=1.0))


@settings(max_examples=20, deadline=None)
@example(seed=2, scale=0.99999, count=16)  # the farthest classes end just at half of the extent
@given(seed=st.integers(0, 1000), scale=st.floats(0.01, 100), count=st.integers(4, SIDE**2))
def test_unit_place_and_order_do_not_matter(seed, scale, count):
    rng = np.random.default_rng(seed)
    x, y = fields(1.0, seed=5)[seed % PAIRS][:, :count]
    places = PLACES[:count]
    order = rng.permutation(count)
    same = spatial_p_value(x[order], np.exp(y[order]), places[order] * scale + 7.0, permuted=0.0)
    assert same == pytest.approx(spatial_p_value(x, y, places, permuted=0.0), rel=1e-9)
