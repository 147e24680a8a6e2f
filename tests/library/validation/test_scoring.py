"""One patch, from its maps to its rows: agreement, errors, chance, and what is not tested."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import contact_of
from gstlib.change.change import height_change
from gstlib.surfaces.grid import make_surface
from gstlib.validation.baselines import BASELINES, ORACLE, Others
from gstlib.validation.scoring import by_chance, other_patches, own_model, score_patch, score_tables

OTHERS = Others.of(
    pd.DataFrame(
        {"pressure_MPa": [10.0, 20.0], "loss_mm": [2e-4, 4e-4], "loss_fraction": [0.02, 0.04]},
        index=["8", "9"],
    ),
    {patch: np.linspace(0, 5e-3, 500) for patch in "89"},
)


def map_of(depth, **more):
    """A prediction by each model: depth (mm) on a grid."""
    fields = {"archard": depth} | more
    stacked = np.stack([np.asarray(field) for field in fields.values()])
    return xr.Dataset({"depth": (("model", "y", "x"), stacked)}, coords={"model": list(fields)})


@pytest.fixture
def patch():
    """A patch that lost height just where it is predicted to, and not at its highest points."""
    rng = np.random.default_rng(3)
    t0 = make_surface(rng.normal(0, 1e-3, (60, 70)), 1e-3)
    worn = 5e-3 * (np.arange(4200).reshape(60, 70) % 37 == 0)
    t1 = t0 - worn + rng.normal(0, 1e-5, t0.shape)
    t1[:, 60:] = np.nan
    return contact_of(t0, worn * 1e3), height_change(t0, t1), map_of(worn)


def scored(patch, name="7", *, others=OTHERS, **changed):
    contact, change, predicted = patch
    options = {"pressure_MPa": 15.0} | changed
    return score_patch(name, contact, change, predicted, others, **options)


def table(found):
    return pd.DataFrame(found.models).set_index("model")


def test_a_perfect_prediction_agrees_and_its_baselines_do_not(patch):
    _, change, predicted = patch
    found, known = scored(patch), np.isfinite(patch[1].change.values)
    rows, row = table(found), found.row
    assert set(rows.index) == {"archard", *BASELINES, ORACLE}
    # noise alone puts about 2.5 % of the rest beyond the level of detection
    true = float((predicted.depth.values[0] > 0)[known].mean())
    assert rows.predicted_worn_fraction["archard"] == pytest.approx(true)
    loss = change.loss.values[known]
    assert rows.predicted_worn_fraction[ORACLE] == pytest.approx(loss.mean(), abs=1 / known.sum())
    assert row["contact_fraction"] == float((predicted.depth > 0).mean())
    ideal = np.corrcoef(predicted.depth.values[0][known] > 0, loss)[0, 1]
    assert row["mcc"] == rows.mcc["archard"] == pytest.approx(ideal)
    assert row["attainable_mcc"] == pytest.approx(ideal)  # every point that it marks was lost
    assert rows.predicted_volume_um3["archard"] == pytest.approx(5 * true * known.sum())
    assert row["predicted_loss_um"] == pytest.approx(5 * true)
    measured = -change.change.values[known & change.loss.values.astype(bool)].sum() * 1e3
    assert rows.measured_volume_um3["none"] == pytest.approx(measured)
    assert row["map_error"] < 0.02
    assert rows.map_error_um["none"] == pytest.approx(
        1e3 * np.sqrt(np.mean(change.change.values[known] ** 2))
    )
    for name in (*BASELINES, ORACLE):
        assert row[f"{name}_mcc"] == rows.mcc[name] < 0.3
    assert (rows.mcc["none"], rows.attainable_mcc["none"]) == (0, 0)


def test_scans_see_what_a_patch_loses_beyond_its_median(patch):
    contact, change, predicted = patch
    deeper = table(scored((contact, change, predicted + 1e-3)))
    pd.testing.assert_frame_equal(deeper, table(scored(patch)), rtol=1e-9)
    ramp = np.linspace(0, 1e-3, 70) * np.ones((60, 1))
    seen = ramp[:, :60] - np.median(ramp[:, :60])
    volume = table(scored((contact, change, map_of(ramp)))).predicted_volume_um3
    # what it leaves above the median is no loss
    assert volume["archard"] == pytest.approx(1e3 * seen.clip(0).sum())


def test_the_study_s_own_prediction_is_that_with_the_interlayer(patch):
    contact, change, predicted = patch
    own, none = predicted.depth.values[0], np.zeros(contact.pressure.shape)
    found = scored((contact, change, map_of(none, interlayer=own, yielding=none)))
    assert found.row["mcc"] == table(found).mcc["interlayer"] > 0.3
    assert table(found).mcc["archard"] == 0
    assert [own_model(of) for of in (["archard"], ["archard", "interlayer", "archard_capped"])] == [
        "archard",
        "interlayer",
    ]
    # the bare stone takes nothing off, so the whole map is out of its contact
    rows = table(found)
    np.testing.assert_allclose(rows.out_of_contact_um, rows.map_error_um)


def test_a_perfect_prediction_is_no_chance_and_a_shifted_one_is(patch):
    contact, change, predicted = patch
    moved = [predicted.roll(x=5 + number, y=9) for number in range(9)]
    found = [scored(patch)]
    found += [scored((contact, change, one), name=f"of {y}") for y, one in enumerate(moved)]
    nulls = by_chance(found)
    assert len(nulls["7"]) == 4 * 10  # not square: no quarter turns
    assert nulls["7"][0] == pytest.approx(found[0].row["mcc"])
    reached = {name: (null[1:] >= null[0]).sum() for name, null in nulls.items()}
    assert reached.pop("7") == 0
    assert min(reached.values()) > 0  # one of the others is that of patch 7


@pytest.mark.parametrize("case", ["noise", "no loss", "no prediction"])
def test_what_cannot_be_tested_against_chance_says_so(patch, case):
    contact, change, predicted = patch
    if case == "no loss":
        change = change.assign(loss=change.loss & False)
    if case == "no prediction":
        predicted = predicted * 0
    found = scored((contact, change, predicted), above_noise=case != "noise")
    assert found.untested == ("noise" if case == "noise" else "undefined")
    assert math.isnan(found.row["mcc"]) == (case == "no loss")
    nulls = by_chance([found, scored(patch, name="8")])
    # a patch that predicts nothing says nothing of chance
    assert {name: len(null) for name, null in nulls.items()} == {
        "8": 4 if case == "no prediction" else 8
    }


def test_the_profile_is_the_mean_loss_of_quarters_of_the_points(patch):
    contact, change, _ = patch
    height, known = contact.interface.height.values, np.isfinite(change.change.values)
    cut = np.maximum(height - np.quantile(height[known], 0.8), 0)
    found = scored((contact, change, map_of(cut)))
    bands = pd.DataFrame(found.bands)
    by_height = bands.pivot(index="model", columns="band", values="loss_um")
    assert by_height.loc["archard"].mean() == pytest.approx(1e3 * cut[known].mean())
    assert by_height.loc["archard", 1] > 0 == by_height.loc["archard", 2]
    lost = np.where(change.loss, -change.change, 0.0)[known]
    assert by_height.loc["measured"].mean() == pytest.approx(1e3 * lost.mean())


def test_tables_with_and_without_patches(patch):
    found = [scored(patch), scored(patch, name="8")]
    tables = score_tables(found, {"7": True, "8": False})
    empty = score_tables([], {})
    assert list(tables["patches"].in_statistics) == [True, False]
    assert len(tables["wear"]) == 2 * (1 + len(BASELINES) + 1)
    for name, of_name in tables.items():
        assert len(empty[name]) == 0 < len(of_name)
    assert "out_of_contact_um" not in tables["wear"]  # only an interlayer is scored there
    assert tables["patches"].notna().all(axis=None)


def test_baselines_know_the_losses_of_the_patches_that_the_prediction_is_fitted_to(patch):
    contact, change, _ = patch
    pressures = pd.DataFrame({"patch": ["7", "8", "9"], "pressure_MPa": [1.0, 2.0, 3.0]})
    losses = {"mean_wear_depth_um": [0.1, 0.2, np.nan], "loss_fraction": [0.01, 0.02, 0.5]}
    registration = pd.DataFrame({"patch": ["7", "8", "9"]} | losses)
    known = {"7": contact, "8": contact}
    others = other_patches(pressures, registration, ["7", "8"], known, dict.fromkeys("78", change))
    assert others.table.loss_mm.tolist() == pytest.approx([1e-4, 2e-4])
    height, is_known = contact.interface.height.values, np.isfinite(change.change.values)
    assert others.displacements.max() == pytest.approx(height.max() - height[is_known].min())
    assert others.without("7").table.index.tolist() == ["8"]
    assert others.without("7").cut.columns.tolist() == ["8"]
    assert others.without("9").table.index.tolist() == ["7", "8"]


def test_a_baseline_knows_the_summit_of_the_patch_and_not_its_loss(patch):
    contact, change, predicted = patch
    own = table(scored(patch, "8")).drop(columns="patch")
    without = table(scored(patch, others=OTHERS.without("8"))).drop(columns="patch")
    pd.testing.assert_frame_equal(own, without)
    height = contact.interface.height.copy()
    height[5, 65] = 0.02  # where the change is not known
    spike = replace(contact, interface=replace(contact.interface, height=height))
    far = table(scored((spike, change, predicted)))
    assert far.predicted_volume_um3["rigid"] == 0 < own.predicted_volume_um3["rigid"]
