"""One patch, from its maps to its rows: agreement, errors, chance, and what is not tested."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import contact_of, written

from gstlib.change.change import height_change
from gstlib.surfaces.grid import make_surface
from gstlib.validation.baselines import BASELINES, ORACLE, Others
from gstlib.validation.scoring import by_chance, other_patches, score_patch

TABLE = written(
    """
    patch, pressure_MPa, loss_mm, loss_fraction
    8,     10,           2e-4,    0.02
    9,     20,           4e-4,    0.04
    """
).set_index("patch")
OTHERS = Others.tabulated(TABLE, dict.fromkeys("89", np.linspace(0, 5e-3, 500)))
# A patch that lost height just where it is predicted to, and not at its highest points.
RNG = np.random.default_rng(3)
T0 = make_surface(RNG.normal(0, 1e-3, (60, 70)), 1e-3)
WORN = 5e-3 * (np.arange(4200).reshape(60, 70) % 37 == 0)
T1 = (T0 - WORN + RNG.normal(0, 1e-5, T0.shape)).where(T0.x < 0.06)
CONTACT, CHANGE = contact_of(T0, WORN * 1e3), height_change(T0, T1)
MEASURED = np.isfinite(CHANGE.change.values)
LOSS = CHANGE.loss.values[MEASURED].astype(bool)
LOST = -CHANGE.change.values[MEASURED]


def scored(name="7", *, contact=CONTACT, change=CHANGE, others=OTHERS, **depths):
    """The patch by its models and their depths, mm."""
    depths = depths or {"archard": WORN}
    stacked = ("model", "y", "x"), np.array([*depths.values()])
    predicted = xr.Dataset({"depth": stacked}, {"model": [*depths]})
    return score_patch(name, contact, change, predicted, others, pressure_MPa=15.0)


def rows_of(score):
    return pd.DataFrame(score.models).set_index("model").drop(columns="patch")


def test_a_perfect_prediction_agrees_and_its_baselines_do_not():
    score = scored()
    rows, row = rows_of(score), score.row
    assert set(rows.index) == {"archard", *BASELINES, ORACLE}
    worn = WORN[MEASURED] > 0
    ideal = np.corrcoef(worn, LOSS)[0, 1]
    assert row["mcc"] == rows.mcc["archard"] == pytest.approx(ideal)
    assert rows.predicted_volume_um3["archard"] == pytest.approx(5 * worn.sum())
    assert row["predicted_loss_um"] == pytest.approx(5 * worn.mean())
    assert rows.measured_volume_um3["none"] == pytest.approx(1e3 * LOST[LOSS].sum())
    assert rows.map_error_um["none"] == pytest.approx(1e3 * np.sqrt(np.mean(LOST**2)))
    assert row["map_error"] < 0.02
    for name in (*BASELINES, ORACLE):
        assert row[f"{name}_mcc"] == rows.mcc[name] < 0.3


def test_the_study_s_own_prediction_is_that_with_the_interlayer():
    score = scored(archard=0 * WORN, interlayer=WORN, yielding=0 * WORN)
    rows = rows_of(score)
    assert score.row["mcc"] == rows.mcc["interlayer"] > 0.3
    # the bare stone takes nothing off, so the whole map is out of its contact
    np.testing.assert_allclose(rows.out_of_contact_um, rows.map_error_um)


def test_a_perfect_prediction_is_no_chance_and_a_shifted_one_is():
    shifted = {f"of {by}": np.roll(WORN, (9, 5 + by), (0, 1)) for by in range(9)}
    others = [scored(name, archard=depth) for name, depth in shifted.items()]
    own = scored()
    nulls = by_chance([own, *others])
    assert len(nulls["7"]) == 2 * 10
    assert nulls["7"][0] == pytest.approx(own.row["mcc"])
    reached = {name: (null[1:] >= null[0]).sum() for name, null in nulls.items()}
    assert reached.pop("7") == 0
    assert min(reached.values()) > 0  # one of the others is that of patch 7


def test_baselines_know_the_losses_of_the_patches_that_the_prediction_is_fitted_to():
    table = written(
        """
        patch, loss_fraction, mean_wear_depth_um, pressure_MPa, leave_one_out_MPa
        7,     0.1,           0.1,                5,            1
        8,     0.1,           0.2,                5,            2
        9,     0.1,           ,                   5,            3
        """
    )
    contacts, changes = dict.fromkeys("78", CONTACT), dict.fromkeys("78", CHANGE)
    others = other_patches(table, table, ["7", "8"], contacts, changes)
    assert others.table.loss_mm.tolist() == pytest.approx([1e-4, 2e-4])
    # pressures that the patch's own wear has not shaped
    assert others.table.pressure_MPa.tolist() == [1.0, 2.0]
    assert others.displacements.max() == pytest.approx(
        T0.max() - T0.values[MEASURED].min()
    )
    assert others.without("7").cut.columns.tolist() == ["8"]


def test_a_baseline_knows_the_summit_of_the_patch_and_not_its_loss():
    own = rows_of(scored("8"))
    pd.testing.assert_frame_equal(own, rows_of(scored(others=OTHERS.without("8"))))
    height = T0.copy()
    height[5, 65] = 0.02  # where the change is not known
    spike = replace(CONTACT, interface=replace(CONTACT.interface, height=height))
    far = rows_of(scored(contact=spike))
    assert far.predicted_volume_um3["rigid"] == 0 < own.predicted_volume_um3["rigid"]
