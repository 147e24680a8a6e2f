"""The baselines do what they say, with the losses of other patches and none of the patch's own."""

import numpy as np
import pytest
from contacts import written

from gstlib.validation.baselines import BASELINES, ORACLE, Others, baseline_depths

RNG = np.random.default_rng(1)
HEIGHTS = {patch: 1e-3 * RNG.standard_normal(5000) for patch in "abcd"}
HEIGHT = HEIGHTS["a"]
TABLE = written(
    """
    patch, pressure_MPa, loss_mm, loss_fraction
    a,     10,           1e-5,    0.02
    b,     20,           3e-5,    0.05
    c,     30,           2e-5,    0.03
    d,     40,           7e-5,    0.04
    """
).set_index("patch")


def depths_of_a(table=TABLE, pressure_MPa=10.0, worn_fraction=0.1):
    below = {patch: height.max() - height for patch, height in HEIGHTS.items()}
    return baseline_depths(
        HEIGHT,
        np.full(HEIGHT.shape, 2e-4),
        summit=float(HEIGHT.max()),
        pressure_MPa=pressure_MPa,
        worn_fraction=worn_fraction,
        others=Others.tabulated(table, below).without("a"),
    )


def test_each_baseline_cuts_what_it_is_told_to():
    depths = depths_of_a()
    assert set(depths) == {*BASELINES, ORACLE}
    assert not depths["none"].any()
    assert depths["mean_volume"].mean() == pytest.approx(4e-5)
    assert depths["pressure_volume"].mean() == pytest.approx(10 * 12e-5 / 90)
    assert np.mean(depths["pressure_fraction"] > 2e-4) == pytest.approx(
        10 * 0.12 / 90, abs=2e-4
    )
    assert np.mean(depths[ORACLE] > 2e-4) == pytest.approx(0.1, abs=2e-4)
    # a plane cuts: what is higher loses more, down to one height
    for name in (*BASELINES[1:], ORACLE):
        left = HEIGHT - depths[name]
        np.testing.assert_allclose(left[depths[name] > 0], left.max(), atol=1e-12)


def test_the_rigid_flat_goes_as_deep_on_each_patch_and_gives_the_others_their_loss():
    sunk = HEIGHT.max() - (HEIGHT - depths_of_a()["rigid"]).max()
    lost = 0.0
    for patch in "bcd":
        below = HEIGHTS[patch].max() - HEIGHTS[patch]
        lost += np.maximum(sunk - below, 0).mean()
    assert lost == pytest.approx(12e-5, rel=1e-3)


def test_no_baseline_sees_what_the_patch_itself_lost():
    table = TABLE.copy()
    table.loc["a", ["loss_mm", "loss_fraction"]] = 1.0
    depths = depths_of_a()
    for name, depth in depths_of_a(table, worn_fraction=0.5).items():
        assert np.array_equal(depth, depths[name]) == (name != ORACLE), name
