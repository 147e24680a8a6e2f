"""Scoring: truth against itself has no error, and every perturbation shows in its own row."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from gstlib.specimen.score import score_truth
from gstlib.surfaces.grid import make_surface


def perfect_scan(true):
    """What preparation would have left of a scan without errors."""
    fields = {
        "height": true.height.astype(float),
        "filled": true.unmeasured,
        "outlier": true.outlier,
        "measured": true.height + 0.03 * true.outlier,
    }
    attrs = {f"tilt_{axis}_mrad": true[f"plane_{axis}_mrad"].item() for axis in "xy"}
    return xr.Dataset(fields, attrs=attrs | {"outlier_scale_um": 0.2})


def perfect_change(true):
    """What registration would have left of a patch without errors."""
    dx, dy, turn = (
        true[name].diff("epoch").item() for name in ("x_mm", "y_mm", "rotation_deg")
    )
    turned = np.exp(-1j * np.deg2rad(true.rotation_deg.sel(epoch="T0").item()))
    shift_um = turned * complex(dx, dy) * 1e3
    return xr.Dataset(
        {"change": -true.wear_depth.astype(float), "loss": true.wear_depth > 0},
        attrs={
            "rotation_deg": turn,
            "shift_x_um": shift_um.real,
            "shift_y_um": shift_um.imag,
            "overlap": true.overlap.item(),
        },
    )


@pytest.fixture
def results(truth):
    """What perfect stages would have left behind, by patch where there are several."""
    names = list(truth.patch.values)
    before = truth.sel(epoch="T0")
    places = {f"{axis}_mm": before[f"nominal_{axis}_mm"].values for axis in "xy"}
    shared = {
        f"shift_{axis}_um": 1e3 * (before[f"{axis}_mm"] - places[f"{axis}_mm"]).mean()
        for axis in "xy"
    }
    pressures = np.arange(len(names), dtype=float)
    return {
        "face": make_surface(truth.macroscale_height.values, 0.1).to_dataset(
            name="height"
        ),
        "scans": {
            (patch, epoch): perfect_scan(truth.sel(patch=patch, epoch=epoch))
            for patch in names
            for epoch in ("T0", "T1")
        },
        "changes": {patch: perfect_change(truth.sel(patch=patch)) for patch in names},
        "placement": pd.DataFrame([{}, shared], dtype=float),
        "pressures": pd.DataFrame(
            {"patch": names, "pressure_MPa": pressures, **places}
        ),
        "two_scales": pd.DataFrame(
            {"patch": 2 * names, "reference_pressure_MPa": [*pressures] * 2}
        ),
    }


def wear_errors(truth, results):
    """Errors of the wear of patch 10, by quantity."""
    table = score_truth(truth, **results).set_index(["stage", "patch"])
    return table.loc["wear", "10"].set_index("quantity").error


def test_truth_against_itself_has_no_error(truth, results):
    table = score_truth(truth, **results)
    np.testing.assert_allclose(table.error.astype(float), 0, atol=2e-4)
    assert table.stage.nunique() == 7
    patches = table[table.patch != ""].groupby("patch").quantity.count()
    assert patches.index.tolist() == sorted(truth.patch.values)
    assert patches.nunique() == 1
    # without a reference no pressure is true
    table = score_truth(truth, **results | {"two_scales": None})
    assert "coupling" not in set(table.stage)


def test_every_perturbed_stage_shows(truth, results):
    rng = np.random.default_rng(1)
    scan = results["scans"]["5", "T0"]
    change = results["changes"]["7"]
    face = results["face"]
    scan.attrs["tilt_x_mrad"] += 1
    scan["outlier"] = scan.outlier.roll(x=7)
    scan["filled"] = scan.filled | (np.arange(scan.sizes["x"]) == 0)
    scan["height"] = scan.height + 1e-4 * rng.standard_normal(scan.height.shape)
    change.attrs["shift_y_um"] += 5
    change.attrs["rotation_deg"] -= 0.25
    change["loss"] = change.loss.roll(y=30)
    results["placement"].loc[1, "shift_x_um"] += 7
    results["pressures"].loc[1, "pressure_MPa"] += 3
    # a plane of the face is no error, but its noise is
    noise = 1e-3 * rng.standard_normal(face.height.shape)
    results["face"] = face + 0.01 * face.x - 0.02 * face.y + 3 + noise
    table = score_truth(truth, **results)
    error = table.set_index(["patch", "quantity"]).error
    assert error["5", "T0 tilt_x"] == 1
    assert error["5", "T1 tilt_x"] == 0
    assert error["5", "T0 filled"] > 30
    assert error["5", "T0 outlier_precision"] < -0.5
    assert error["5", "T0 height_rms_error"] == pytest.approx(0.1, rel=0.05)
    assert error["7", "shift_y"] == pytest.approx(5)
    assert error["7", "rotation"] == pytest.approx(-0.25)
    assert error["7", "pressure"] == pytest.approx(3)
    assert error["7", "loss_recall"] < -0.2
    assert error["", "shared shift_x"] == pytest.approx(7)
    assert error["", "height_rms_error"] == pytest.approx(1.0, rel=0.05)


def test_shallow_traces_are_neither_false_nor_missed_and_only_the_overlap_counts(
    truth, results
):
    change = results["changes"]["10"]
    depth = truth.sel(patch="10").wear_depth
    deep = depth > truth.attrs["wear_threshold_um"] * 1e-3
    assert change.loss.sum() > deep.sum()
    change["loss"] = deep
    off = 0.2e-3 * (depth > 0) + 0.1e-3
    change["change"] = change.change + off
    wear = wear_errors(truth, results)
    quantities = ["loss_precision", "loss_recall", "false_loss_fraction"]
    np.testing.assert_allclose(wear[quantities], 0, atol=1e-12)
    change["change"] = change.change.where(change.x < 0.4)
    wear = wear_errors(truth, results)
    assert wear.change_bias_unworn == pytest.approx(0.1, abs=1e-6)
    assert wear.change_bias_worn == pytest.approx(0.3, abs=1e-6)
