"""A scan through all of its preparation, against the stone that it was made from."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from gstlib.errors import ConfigError, InputError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.preprocess.scan import prepare_scan
from gstlib.surface import make_surface

SETTINGS = {
    "mould_invert": True,
    "mould_flip": "x",
    "maximum_unmeasured": 0.05,
    "outlier_half_width": 5,
    "outlier_share": 0.01,
}


@pytest.fixture
def case():
    """A stone, and the scan of its mould: tilted, with spikes and holes."""
    rng = np.random.default_rng(5)
    stone = gaussian_filter(rng.normal(size=(128, 128)), 4) * 5e-2
    rows, columns = np.indices(stone.shape)
    y, x = rows - rows.mean(), columns - columns.mean()
    stone -= stone.mean()  # and no tilt of its own
    stone -= y * (y * stone).sum() / (y**2).sum() + x * (x * stone).sum() / (x**2).sum()
    spikes = np.zeros(stone.shape, bool)
    spikes[10:120:12, 7:120:12] = True
    holes = np.zeros(stone.shape, bool)
    holes[60:64, 30:40] = holes[100:106, 80:84] = True
    seen = stone + 0.2 + 1e-3 * (0.004 * rows - 0.003 * columns)
    mould = -(np.where(holes, math.nan, seen + 0.03 * spikes))[:, ::-1]
    return stone, spikes & ~holes, holes, make_surface(mould, 1e-3, file="a.plu", vendor="V")


@pytest.mark.parametrize("rule", ["window", "median"])
def test_stone_is_recovered(case, rule):
    stone, spikes, holes, raw = case
    scan = prepare_scan(raw, **SETTINGS, outlier_rule=rule)
    np.testing.assert_array_equal(scan.filled, holes)
    np.testing.assert_array_equal(scan.outlier, scan[f"outlier_{rule}"])
    assert not (scan.outlier & scan.filled).any()
    assert scan.outlier.values[spikes].all()
    error = scan.height.values - stone
    # Where nothing was replaced, the plane's fit is all that can be off.
    kept = ~holes & ~scan.outlier.values
    assert np.abs(error[kept]).max() < 0.01 * stone.std()
    assert np.abs(error[spikes]).max() < 0.2 * stone.std()
    assert np.sqrt(np.mean(error**2)) < 0.03 * stone.std()


def test_every_step_is_counted(case):
    stone, _, holes, raw = case
    attrs = prepare_scan(raw, **SETTINGS).attrs
    assert attrs["unmeasured"] == attrs["filled"] == holes.sum()
    assert attrs["points"] == stone.size
    assert attrs["unmeasured_share"] == holes.mean()
    assert 0 < attrs["outliers"] <= 0.01 * stone.size
    assert attrs["outlier_share"] == attrs["outliers"] / stone.size
    assert attrs["tilt_y_mrad"] == pytest.approx(4.0, abs=0.1)
    assert attrs["tilt_x_mrad"] == pytest.approx(-3.0, abs=0.1)
    assert attrs["Sq_after_um"] < attrs["Sq_before_um"]
    assert attrs["Sq_after_um"] == pytest.approx(1e3 * stone.std(), rel=0.01)
    assert attrs["file"] == "a.plu"
    assert attrs["vendor"] == "V"


def test_both_rules_are_compared_whichever_is_in_force(case):
    _, spikes, _, raw = case
    window, median = (prepare_scan(raw, **SETTINGS, outlier_rule=r) for r in ("window", "median"))
    for name in ("outlier_window", "outlier_median"):
        np.testing.assert_array_equal(window[name], median[name])
    for scan, rule in ((window, "window"), (median, "median")):
        assert scan.attrs["outlier_rule"] == rule
        assert scan.attrs["outliers"] == scan.attrs[f"outliers_{rule}"] == scan.outlier.sum()
        assert scan.attrs["outlier_k"] == scan.attrs[f"outlier_k_{rule}"]
    both = (window.outlier & median.outlier).sum()
    assert window.attrs["outliers_both"] == median.attrs["outliers_both"] == both
    np.testing.assert_array_equal(median.outlier, spikes)
    assert window.outlier.sum() > median.outlier.sum()  # it takes its share


def test_highest_points_are_above_the_plane_and_on_the_stones_side(case):
    stone, _, _, raw = case
    attrs = prepare_scan(raw, **SETTINGS, outlier_rule="median").attrs
    assert attrs["highest_after_um"] == pytest.approx(1e3 * stone.max(), rel=0.05)
    assert attrs["highest_before_um"] > 1e3 * stone.max() + 10
    assert attrs["highest_before_um"] < 1e3 * stone.max() + 31


@pytest.mark.parametrize("rule", ["window", "median"])
def test_a_spike_beside_a_hole_does_not_spread_into_it(case, rule):
    stone, _, holes, _ = case
    spikes = np.zeros_like(holes)
    spikes[59, 33:36] = spikes[64, 32] = spikes[102, 84] = True
    raw = make_surface(-np.where(holes, math.nan, stone + 0.03 * spikes)[:, ::-1], 1e-3)
    scan = prepare_scan(raw, **SETTINGS, outlier_rule=rule)
    assert scan.outlier.values[spikes].all()
    assert np.abs(scan.height.values - stone)[holes | spikes].max() < 0.5 * stone.std()


def test_a_rule_that_there_is_not(case):
    with pytest.raises(ConfigError, match=r"outlier_rule: is 'mean'\. One of: window, median"):
        prepare_scan(case[3], **SETTINGS, outlier_rule="mean")


def test_can_be_stored_and_given_back(case, tmp_path):
    scan = prepare_scan(case[3], **SETTINGS)
    write_dataset(tmp_path / "a.h5", scan)
    again = read_dataset(tmp_path / "a.h5")
    np.testing.assert_array_equal(again.height, scan.height)
    assert again.attrs["outlier_k"] == scan.attrs["outlier_k"]
    assert again.height.attrs["units"] == "mm"


def test_scan_full_of_holes(case):
    raw = case[3].copy()
    raw[:20] = math.nan
    with pytest.raises(InputError, match=r"a\.plu: .* % of the points are unmeasured"):
        prepare_scan(raw, **SETTINGS)
