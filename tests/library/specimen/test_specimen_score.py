"""Scoring: truth against itself has no error, and every perturbation shows in its own row."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from gstlib.specimen.score import score_truth
from gstlib.surfaces.grid import make_surface


@pytest.fixture
def results(truth):
    """What perfect stages would have left behind, by patch where there are several."""
    scans, changes, before = {}, {}, truth.sel(epoch="T0")
    for patch in truth.patch.values:
        at = truth.sel(patch=patch)
        for epoch in ("T0", "T1"):
            one = at.sel(epoch=epoch)
            attrs = {f"tilt_{axis}_mrad": one[f"plane_{axis}_mrad"].item() for axis in "xy"}
            prepared = {"height": at.height.astype(float), "filled": one.unmeasured}
            prepared |= {"outlier": one.outlier, "measured": at.height + 0.03 * one.outlier}
            scans[patch, epoch] = xr.Dataset(prepared, attrs=attrs | {"outlier_scale_um": 0.2})
        dx, dy, turn = (at[name].diff("epoch").item() for name in ("x_mm", "y_mm", "rotation_deg"))
        turned = np.exp(-1j * np.deg2rad(before.rotation_deg.sel(patch=patch).item()))
        shift = turned * complex(dx, dy) * 1e3
        attrs = {"rotation_deg": turn, "shift_x_um": shift.real, "shift_y_um": shift.imag}
        changes[patch] = xr.Dataset(
            {"change": -at.wear_depth.astype(float), "loss": at.wear_depth > 0},
            attrs=attrs | {"overlap": at.overlap.item()},
        )
    names = list(truth.patch.values)
    stated = {f"{a}_mm": before[f"nominal_{a}_mm"].values for a in "xy"}
    together = {
        f"shift_{a}_um": float((before[f"{a}_mm"] - stated[f"{a}_mm"]).mean()) * 1e3 for a in "xy"
    }
    pressures = pd.DataFrame({"patch": names, "pressure_MPa": np.arange(len(names), dtype=float)})
    pressures = pressures.assign(**stated)
    twice = pd.concat(2 * [pressures.rename(columns={"pressure_MPa": "reference_pressure_MPa"})])
    return {
        "face": make_surface(truth.macroscale_height.values, 0.1).to_dataset(name="height"),
        "scans": scans,
        "changes": changes,
        "placement": pd.DataFrame([{"patch": names[0]}, {"patch": "all", **together}]),
        "pressures": pressures,
        "two_scales": twice.assign(variant=len(names) * ["equilibrium"] + len(names) * ["paper"]),
    }


def errors(table, quantity, patch="10", stage=None):
    table = table[(table.quantity == quantity) & (table.patch == patch)]
    return (table if stage is None else table[table.stage == stage]).error.item()


def test_truth_against_itself_has_no_error(truth, results):
    table = score_truth(truth, **results)
    np.testing.assert_allclose(table.error.astype(float), 0, atol=2e-4)
    assert not table.duplicated(["stage", "quantity", "patch"]).any()
    assert table.stage.nunique() == 7
    patches = table[table.patch != ""].groupby("patch").quantity.count()
    assert patches.index.tolist() == sorted(truth.patch.values)
    assert patches.nunique() == 1


def test_every_perturbed_stage_shows(truth, results):
    rng = np.random.default_rng(1)
    surface = results["scans"]["5", "T0"]
    surface.attrs["tilt_x_mrad"] += 1
    surface["outlier"] = surface.outlier.copy(data=np.roll(surface.outlier.values, 7, axis=1))
    surface["filled"] = surface.filled | (np.arange(surface.sizes["x"]) == 0)
    surface["height"] = surface.height + 1e-4 * rng.standard_normal(surface.height.shape)
    registered = results["changes"]["7"]
    registered.attrs["shift_y_um"] += 5
    registered.attrs["rotation_deg"] -= 0.25
    registered["loss"] = registered.loss.copy(data=np.roll(registered.loss.values, 30, axis=0))
    results["placement"].loc[1, "shift_x_um"] += 7
    results["pressures"].loc[1, "pressure_MPa"] += 3
    face = results["face"]  # its plane is no error, but its noise is
    noise = 1e-3 * rng.standard_normal(face.height.shape)
    results["face"] = face + 0.01 * face.x - 0.02 * face.y + 3 + noise
    table = score_truth(truth, **results)
    assert errors(table, "T0 tilt_x", "5") == 1
    assert errors(table, "T1 tilt_x", "5") == 0
    assert errors(table, "T0 height_rms_error", "5") == pytest.approx(0.1, rel=0.05)
    assert errors(table, "shift_y", "7", "registration") == pytest.approx(5)
    assert errors(table, "rotation", "7") == pytest.approx(-0.25)
    assert errors(table, "shared shift_x", "") == pytest.approx(7)
    assert errors(table, "pressure", "7") == pytest.approx(3)
    assert errors(table, "height_rms_error", "") == pytest.approx(1.0, rel=0.05)
    assert errors(table, "T0 filled", "5") > 30
    assert errors(table, "T0 outlier_precision", "5") < -0.5
    assert errors(table, "loss_recall", "7") < -0.2


def test_shallow_traces_are_neither_false_nor_missed_and_only_the_overlap_counts(truth, results):
    registered = results["changes"]["10"]
    deep = truth.sel(patch="10").wear_depth > truth.attrs["wear_threshold_um"] * 1e-3
    assert registered.loss.sum() > deep.sum()
    registered["loss"] = deep
    table = score_truth(truth, **results)
    for quantity in ("loss_precision", "loss_recall", "false_loss_fraction", "worn_fraction"):
        assert errors(table, quantity) == pytest.approx(0, abs=1e-12)
    off = 0.2e-3 * (truth.sel(patch="10").wear_depth > 0) + 0.1e-3
    registered["change"] = (registered.change + off).where(registered.x < 0.4)
    table = score_truth(truth, **results)
    assert errors(table, "change_bias_unworn") == pytest.approx(0.1, abs=1e-6)
    assert errors(table, "change_bias_worn") == pytest.approx(0.3, abs=1e-6)
    expected = 1e3 * np.sqrt((off.where(off.x < 0.4) ** 2).mean().item())
    assert errors(table, "change_rms_error") == pytest.approx(expected, rel=1e-5)
    registered["change"] = registered.change * np.nan
    table = score_truth(truth, **results)
    assert "10" not in set(table.patch[table.stage == "wear"])


def test_without_a_reference_no_pressure_is_true(truth, results):
    table = score_truth(truth, **results | {"two_scales": None})
    assert "coupling" not in set(table.stage)
