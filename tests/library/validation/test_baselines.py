"""The baselines do what they say, with the losses of other patches and none of the patch's own."""

import numpy as np
import pandas as pd
import pytest
from gstlib.validation.baselines import BASELINES, ORACLE, Others, baseline_depths

RNG = np.random.default_rng(1)
HEIGHTS = {patch: 1e-3 * RNG.standard_normal(5000) for patch in "abcd"}
TABLE = pd.DataFrame(
    {
        "pressure_MPa": [10.0, 20.0, 30.0, 40.0],
        "loss_mm": [1e-5, 3e-5, 2e-5, 7e-5],
        "loss_fraction": [0.02, 0.05, 0.03, 0.04],
    },
    index=list("abcd"),
)


def others():
    return Others.of(TABLE, {patch: of.max() - of for patch, of in HEIGHTS.items()})


def depths(patch="a", *, worn_fraction=0.1, level=2e-4, known=others, **changed):
    height = HEIGHTS[patch]
    options = {"pressure_MPa": TABLE.pressure_MPa[patch]} | changed
    return baseline_depths(
        height,
        np.full(height.shape, level),
        summit=float(height.max()),
        worn_fraction=worn_fraction,
        others=known().without(patch),
        **options,
    )


def test_each_baseline_cuts_what_it_is_told_to():
    found = depths()
    assert set(found) == {*BASELINES, ORACLE}
    assert not found["none"].any()
    assert found["mean_volume"].mean() == pytest.approx(4e-5)
    assert found["pressure_volume"].mean() == pytest.approx(10 * 12e-5 / 90)
    assert np.mean(found["pressure_fraction"] > 2e-4) == pytest.approx(10 * 0.12 / 90, abs=2e-4)
    assert np.mean(found[ORACLE] > 2e-4) == pytest.approx(0.1, abs=2e-4)
    # a plane cuts: what is higher loses more, down to one height
    for name in (*BASELINES[1:], ORACLE):
        left = HEIGHTS["a"] - found[name]
        np.testing.assert_allclose(left[found[name] > 0], left.max(), atol=1e-12)


def test_the_rigid_flat_goes_as_deep_on_each_patch_and_gives_the_others_their_loss():
    found = depths()["rigid"]
    sunk = HEIGHTS["a"].max() - (HEIGHTS["a"] - found).max()
    lost = sum(
        np.maximum(HEIGHTS[patch] - HEIGHTS[patch].max() + sunk, 0).mean() for patch in "bcd"
    )
    assert lost == pytest.approx(12e-5, rel=1e-3)


def test_no_baseline_sees_what_the_patch_itself_lost():
    mine = TABLE.copy()
    mine.loc["a", ["loss_mm", "loss_fraction"]] = 1.0
    changed = Others.of(mine, {patch: of.max() - of for patch, of in HEIGHTS.items()})
    for name, depth in depths(known=lambda: changed, worn_fraction=0.5).items():
        same = np.array_equal(depth, depths()[name])
        assert same == (name != ORACLE), name


def test_a_patch_that_bears_nothing_is_spared_by_those_that_know_pressures():
    found = depths(pressure_MPa=0.0, worn_fraction=0.0)
    silent = {name for name, depth in found.items() if not depth.any()}
    assert silent == {"none", "pressure_volume", "pressure_fraction", ORACLE}
