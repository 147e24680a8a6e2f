"""Height change: levelled on what did not wear, with an honest level of detection."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.io.store import read_dataset, write_dataset
from gstlib.surface import make_surface
from gstlib.validation.change import height_change, wear_summary
from gstlib.validation.registration import apply_registration, register

SPACING = 1.66e-3


def plateau(share, depth, *, noise=0.1e-3, tilt=0.0, seed=0, size=80):
    """T0 and T1 where the first `share` of the rows lost `depth` mm, and the true loss."""
    rng = np.random.default_rng(seed)
    t0 = rng.normal(0, 3e-3, (size, size))
    lost = np.zeros_like(t0, dtype=bool)
    lost[: round(share * size)] = True
    t1 = t0 - depth * lost + rng.normal(0, noise, t0.shape)
    t1 = t1 + tilt * SPACING * np.indices(t0.shape)[1] + 5e-3
    return make_surface(t0, SPACING), make_surface(t1, SPACING), lost


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.45])
def test_wear_of_nearly_half_does_not_pull_the_datum(share):
    t0, t1, lost = plateau(share, 2e-3, tilt=1e-3)
    result = height_change(t0, t1)
    change = result["change"].values
    assert change[~lost].mean() == pytest.approx(0, abs=0.02e-3)
    if lost.any():
        assert change[lost].mean() == pytest.approx(-2e-3, abs=0.02e-3)
        assert (result["loss"].values & lost).sum() > 0.99 * lost.sum()
    assert result.attrs["change_sigma_um"] == pytest.approx(0.1, rel=0.05)
    assert result.attrs["level_of_detection_um"] == pytest.approx(0.196, rel=0.05)


def test_one_in_forty_unchanged_points_exceeds_the_level_of_detection():
    t0, t1, _ = plateau(0.0, 0.0, size=200)
    summary = wear_summary(height_change(t0, t1))
    assert summary["loss_fraction"] == pytest.approx(0.025, abs=0.006)
    assert summary["gain_fraction"] == pytest.approx(0.025, abs=0.006)


def test_against_true_wear_after_registration(remeasure):
    t0, t1, truth = remeasure((13.4, -9.7), wear=0.12)
    registration = register(t0, t1, maximum_shift_mm=0.1)
    result = height_change(t0, apply_registration(t1, registration, t0))
    inside = np.isfinite(result["change"].values)
    error = (result["change"].values - truth)[inside]
    assert np.median(error) == pytest.approx(0, abs=0.05e-3)
    assert np.median(np.abs(error)) < 0.3e-3
    deep = inside & (truth < -1e-3)
    assert result["loss"].values[deep].mean() > 0.95
    assert result["loss"].values[inside & (truth == 0)].mean() < 0.05


def test_outside_the_overlap_is_nan_and_no_loss():
    t0, t1, _ = plateau(0.2, 2e-3)
    t1[:, :20] = np.nan
    result = height_change(t0, t1)
    assert np.isnan(result["change"][:, :20]).all()
    assert np.isnan(result["t1"][:, :20]).all()
    assert not result["loss"][:, :20].any()


def test_summary_of_a_plateau_by_hand():
    t0, t1, _ = plateau(0.25, 2e-3, noise=1e-9)
    summary = wear_summary(height_change(t0, t1))
    area = 80 * 80 * SPACING**2
    # a fortieth of the unchanged part is noise beyond its own level of detection
    assert summary["loss_fraction"] == pytest.approx(0.25 + 0.75 * 0.025, abs=0.01)
    assert summary["loss_area_mm2"] == pytest.approx(summary["loss_fraction"] * area)
    assert summary["loss_depth_um"] == pytest.approx(0.5 / summary["loss_fraction"], rel=1e-3)
    assert summary["loss_per_area_um"] == pytest.approx(0.5, rel=1e-3)
    assert summary["loss_volume_um3"] == pytest.approx(0.25 * area * 1e6 * 2.0, rel=1e-3)


@settings(max_examples=20, deadline=None)
@given(tilt=st.floats(-5e-3, 5e-3), offset=st.floats(-0.1, 0.1), seed=st.integers(0, 100))
def test_datum_and_tilt_of_the_second_measurement_do_not_matter(tilt, offset, seed):
    t0, t1, _ = plateau(0.2, 2e-3, seed=seed, size=40)
    plane = offset + tilt * SPACING * np.indices(t0.shape)[0]
    one, other = height_change(t0, t1), height_change(t0, t1 + plane)
    np.testing.assert_allclose(other["change"], one["change"], atol=0.05e-3)


def test_result_is_stored_as_it_is(tmp_path):
    t0, t1, _ = plateau(0.2, 2e-3)
    before = t0.copy(deep=True), t1.copy(deep=True)
    result = height_change(t0, t1)
    xr.testing.assert_identical(t0, before[0])
    xr.testing.assert_identical(t1, before[1])
    write_dataset(tmp_path / "registered.h5", result)
    again = read_dataset(tmp_path / "registered.h5")
    assert wear_summary(again) == wear_summary(result)


def test_no_overlap_is_refused():
    t0, t1, _ = plateau(0.0, 0.0)
    with pytest.raises(ValueError, match="0 points"):
        height_change(t0, t1 * np.nan)
    with pytest.raises(ValueError, match="shape"):
        height_change(t0, t1[1:])
