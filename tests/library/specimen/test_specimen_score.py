"""Scoring: truth against itself has no error, and every perturbation shows in its own row."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.ndimage import label

from gstlib.errors import InputError
from gstlib.io.store import write_dataset
from gstlib.specimen import score_truth, true_surface


@pytest.fixture
def results(truth):
    """What perfect stages would have left behind."""
    surfaces, registered = {}, {}
    for patch in truth.patch.values:
        at = truth.sel(patch=patch)
        t0, t1 = at.sel(epoch="T0"), at.sel(epoch="T1")
        for epoch in ("T0", "T1"):
            one = at.sel(epoch=epoch)
            surfaces[patch, epoch] = xr.Dataset(
                {
                    "height": at.height.astype(float),
                    "filled": one.unmeasured,
                    "outlier": one.outlier,
                    "outlier_window": one.outlier,
                    "outlier_median": one.outlier,
                    "measured": at.height + 0.03 * one.outlier,
                },
                attrs={f"tilt_{axis}_mrad": one[f"plane_{axis}_mrad"].item() for axis in "xy"}
                | {"outlier_scale_um": 0.2},
            )
        turn = np.deg2rad(t0.rotation_deg.item())
        shift = np.exp(-1j * turn) * complex((t1.x_mm - t0.x_mm), (t1.y_mm - t0.y_mm)) * 1e3
        registered[patch] = xr.Dataset(
            {"change": -at.wear_depth.astype(float), "loss": at.wear_depth > 0},
            attrs={
                "registration_found": 1,
                "rotation_deg": (t1.rotation_deg - t0.rotation_deg).item(),
                "shift_x_um": shift.real,
                "shift_y_um": shift.imag,
                "overlap": at.overlap.item(),
            },
        )
    names = list(truth.patch.values)
    return {
        "macroscale": true_surface(truth).to_dataset(name="height"),
        "surfaces": surfaces,
        "registered": registered,
        "patch_pressures": pd.DataFrame(
            {
                "patch": names,
                "x_mm": truth.nominal_x_mm.values,
                "y_mm": truth.nominal_y_mm.values,
                "pressure_MPa": np.arange(len(names)),
            }
        ),
        "true_pressures": pd.Series(np.arange(len(names), dtype=float), index=names),
    }


def errors(table, **which):
    for column, value in which.items():
        table = table[table[column] == value]
    return table.error


def test_truth_against_itself_has_no_error(truth, results):
    table = score_truth(truth, **results)
    assert list(table.columns) == [
        "stage", "quantity", "patch", "unit", "true", "recovered", "error",
    ]  # fmt: skip
    placed = table.quantity.isin(["place_x", "place_y"])  # the pipeline knows nominal places only
    np.testing.assert_allclose(table[~placed].error.astype(float), 0, atol=2e-4)
    assert (table[placed].error != 0).all()
    assert not table.duplicated(["stage", "quantity", "patch"]).any()
    assert set(table.stage) == {
        "macroscale",
        "preprocessing",
        "microscale input",
        "registration",
        "wear",
        "coupling",
    }


def test_paths_do_as_well(truth, results, specimen, tmp_path):
    surface = results["macroscale"]
    write_dataset(tmp_path / "surface.h5", surface)
    table = score_truth(specimen.truth, macroscale=tmp_path / "surface.h5")
    pd.testing.assert_frame_equal(table, score_truth(truth, macroscale=surface))


def test_a_plane_on_the_macroscale_surface_is_no_error(truth, results):
    surface = results["macroscale"]
    tilted = surface + 0.01 * surface.x - 0.02 * surface.y + 3
    assert np.abs(score_truth(truth, macroscale=tilted).error).max() < 1e-9


def test_noise_on_the_macroscale_surface_shows(truth, results, rng):
    surface = results["macroscale"]
    noisy = surface + 1e-3 * rng.standard_normal(surface.height.shape)
    table = score_truth(truth, macroscale=noisy)
    error = errors(table, quantity="height_rms_error").item()
    assert error == pytest.approx(1.0, rel=0.05)


def test_every_perturbed_stage_shows(truth, results, rng):
    surface = results["surfaces"]["5", "T0"]
    surface.attrs["tilt_x_mrad"] += 1
    surface["outlier"] = surface.outlier.copy(data=np.roll(surface.outlier.values, 7, axis=1))
    surface["filled"] = surface.filled | surface.outlier
    surface["height"] = surface.height + 1e-4 * rng.standard_normal(surface.height.shape)
    registered = results["registered"]["7"]
    registered.attrs["shift_y_um"] += 5
    registered["loss"] = registered.loss.copy(data=np.roll(registered.loss.values, 30, axis=0))
    results["patch_pressures"].loc[2, "pressure_MPa"] += 4
    table = score_truth(truth, **results)

    assert errors(table, patch="5", quantity="T0 tilt_x").item() == pytest.approx(1)
    assert errors(table, patch="5", quantity="T1 tilt_x").item() == 0
    assert errors(table, patch="5", quantity="T0 outliers").item() == 0
    assert errors(table, patch="5", quantity="T0 outlier_precision").item() < -0.5
    assert errors(table, patch="5", quantity="T0 outlier_recall").item() < -0.5
    assert errors(table, patch="5", quantity="T0 filled_elsewhere").item() > 0
    height = errors(table, patch="5", quantity="T0 height_rms_error").item()
    assert height == pytest.approx(0.1, rel=0.05)
    assert errors(table, patch="7", quantity="shift_y").item() == pytest.approx(5)
    offset = errors(table, patch="7", quantity="offset_error").item()
    assert offset == pytest.approx(5 / (truth.y.attrs["spacing"] * 1e3), rel=1e-3)
    assert errors(table, patch="7", quantity="loss_precision").item() < -0.3
    assert errors(table, patch="7", quantity="false_loss_share").item() > 0.05
    assert errors(table, patch="10", quantity="pressure").item() == pytest.approx(4)


def test_spikes_that_a_rule_leaves_are_counted_once_each_and_only_where_they_stand_up(
    truth, results
):
    surface = results["surfaces"]["5", "T1"]
    outlier = surface.outlier.values
    surface["outlier_median"] = surface.outlier & False
    down = np.arange(outlier.shape[1]) < 20
    surface["measured"] = surface.measured - 0.06 * (surface.outlier & down)
    table = score_truth(truth, surfaces={("5", "T1"): surface})
    left = errors(table, quantity="T1 median_leftover_spikes").item()
    assert left == label(outlier & ~down, np.ones((3, 3)))[1]
    assert left > 10
    assert errors(table, quantity="T1 window_leftover_spikes").item() == 0
    assert errors(table, quantity="T1 median_recall").item() == -1
    assert errors(table, quantity="T1 outlier_recall").item() == 0


def test_only_the_overlap_is_scored(truth, results):
    registered = results["registered"]["10"]
    registered["change"] = registered.change.where(registered.x < 0.4)
    registered["loss"] = registered.loss & (registered.x < 0.4)
    table = score_truth(truth, registered={"10": registered})
    assert np.abs(errors(table, stage="wear").astype(float)).max() < 2e-4


def test_a_change_that_is_off_shows_as_bias_and_as_rms_error(truth, results, rng):
    registered = results["registered"]["10"]
    off = 0.2e-3 * (truth.sel(patch="10").wear_depth > 0) + 0.1e-3
    registered["change"] = registered.change + off
    table = score_truth(truth, registered={"10": registered})
    assert errors(table, quantity="change_bias_unworn").item() == pytest.approx(0.1, abs=1e-6)
    assert errors(table, quantity="change_bias_worn").item() == pytest.approx(0.3, abs=1e-6)
    registered["change"] = registered.change + 1e-3 * rng.standard_normal(off.shape)
    table = score_truth(truth, registered={"10": registered})
    expected = np.hypot(1.0, 1e3 * np.sqrt((off**2).mean().item()))
    assert errors(table, quantity="change_rms_error").item() == pytest.approx(expected, rel=0.05)


def test_traces_too_shallow_to_count_are_neither_false_nor_missed(truth, results):
    registered = results["registered"]["10"]
    deep = truth.sel(patch="10").wear_depth > truth.attrs["wear_threshold_um"] * 1e-3
    assert registered.loss.sum() > deep.sum()
    for loss in (registered.loss, deep):
        table = score_truth(truth, registered={"10": registered.assign(loss=loss)})
        for quantity in ("loss_precision", "loss_recall", "false_loss_share", "worn_share"):
            assert errors(table, quantity=quantity).item() == pytest.approx(0, abs=1e-12)


def test_results_of_another_specimen_are_refused(truth, results):
    with pytest.raises(InputError, match="patch 99 is not in it"):
        score_truth(truth, registered={"99": results["registered"]["5"]})
    with pytest.raises(InputError, match=r"shape \(25, 50\)"):
        score_truth(truth, macroscale=results["macroscale"].isel(y=slice(25)))


@pytest.fixture
def rng():
    return np.random.default_rng(1)
