"""A scan through all of its preparation, and each step of it, against the stone it came from."""

import math

import numpy as np
import pytest
from gstlib.errors import InputError
from gstlib.preprocess.scans import check_unmeasured, interpolate_holes, prepare_patch, prepare_scan
from gstlib.surfaces.grid import make_surface
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, gaussian_filter

PREPROCESSING = {"maximum_unmeasured": 0.05, "outlier_fraction": 0.01}
SETTINGS = PREPROCESSING | {"mould_invert": True, "mould_flip": "x"}


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
    return stone, spikes & ~holes, holes, make_surface(mould, 1e-3, file="a.plu")


@pytest.mark.parametrize("rule", ["window", "median"])
def test_stone_is_recovered(case, rule):
    stone, spikes, holes, raw = case
    scan = prepare_scan(raw, **SETTINGS, outlier_rule=rule)
    np.testing.assert_array_equal(scan.filled, holes)
    assert not (scan.outlier & scan.filled).any()
    assert scan.outlier.values[spikes].all()
    error = scan.height.values - stone
    # Where nothing was replaced, only the fit of the plane can differ.
    kept = ~holes & ~scan.outlier.values
    assert np.abs(error[kept]).max() < 0.01 * stone.std()
    assert np.abs(error[spikes]).max() < 0.2 * stone.std()
    np.testing.assert_array_equal(scan.measured, np.float32(-raw.values[:, ::-1]))


def test_every_step_is_counted(case):
    stone, spikes, holes, raw = case
    window = prepare_scan(raw, **SETTINGS, outlier_rule="window")
    median = prepare_scan(raw, **SETTINGS, outlier_rule="median", outlier_median_threshold=6.0)
    np.testing.assert_array_equal(median.outlier, spikes)
    for scan in (window, median):
        attrs = scan.attrs
        assert attrs["unmeasured"] == attrs["filled"] == holes.sum()
        assert attrs["outliers"] == scan.outlier.sum() <= 0.01 * stone.size
        assert attrs["tilt_y_mrad"] == pytest.approx(4.0, abs=0.1)
        assert attrs["tilt_x_mrad"] == pytest.approx(-3.0, abs=0.1)
        assert attrs["Sq_before_um"] == pytest.approx(1e3 * np.nanstd(raw.values))
        assert attrs["Sq_after_um"] == pytest.approx(1e3 * stone.std(), rel=0.01)


@pytest.mark.parametrize("rule", ["window", "median"])
def test_a_spike_beside_a_hole_does_not_spread_into_it(case, rule):
    stone, _, holes, _ = case
    spikes = np.zeros_like(holes)
    spikes[59, 33:36] = spikes[64, 32] = spikes[102, 84] = True
    raw = make_surface(-np.where(holes, math.nan, stone + 0.03 * spikes)[:, ::-1], 1e-3)
    scan = prepare_scan(raw, **SETTINGS, outlier_rule=rule)
    assert scan.outlier.values[spikes].all()
    assert np.abs(scan.height.values - stone)[holes | spikes].max() < 0.5 * stone.std()


def test_a_patch_is_cut_out_of_a_scan_before_it_is_prepared(case):
    raw = case[3]

    def prepare(crop, size_mm, invert=True, flip="x", own=""):
        scans = {"size_mm": size_mm, "mould": {"invert": invert, "flip": flip}}
        options = {"scans": scans, "preprocessing": PREPROCESSING, "flip": own}
        return prepare_patch(raw, crop=crop, **options)

    assert prepare(None, 0.128).identical(prepare_scan(raw, **SETTINGS))
    # in the scan as measured, whose columns are the stone's reversed
    measured = np.float32(raw.values)
    piece = -measured[16:80, 64:128][:, ::-1]
    np.testing.assert_array_equal(prepare((-0.016, 0.032), 0.064).measured, piece)
    np.testing.assert_array_equal(prepare(None, 0.128, False, None).measured, measured)
    # a patch's own flip goes before the config's; none is one, too
    for own, laid in (("y", measured[::-1]), ("none", measured), ("", measured[:, ::-1])):
        np.testing.assert_array_equal(prepare(None, 0.128, False, "x", own).measured, laid)
    with pytest.raises(InputError, match=r"a\.plu: the scan is 0\.128 × 0\.128 mm"):
        prepare(None, 0.064)


def test_a_later_scan_stays_whole_and_lies_about_its_piece(case):
    raw, (y_mm, x_mm), size_mm = case[3], (-0.016, 0.032), 0.064
    for flip in ("x", "y", None):
        scans = {"size_mm": size_mm, "mould": {"invert": True, "flip": flip}}
        options = {"crop": (y_mm, x_mm), "scans": scans, "preprocessing": PREPROCESSING}
        t0, t1 = (prepare_patch(raw, epoch=epoch, **options) for epoch in ("T0", "T1"))
        assert t1.height.shape == raw.shape
        inside = t1.measured[(t1.y > 0) & (t1.y < size_mm), (t1.x > 0) & (t1.x < size_mm)]
        np.testing.assert_array_equal(inside, t0.measured)
    with pytest.raises(InputError, match="smaller than the study's patches"):
        prepare_patch(raw, epoch="T1", **options | {"scans": scans | {"size_mm": 0.2}})


def test_limit_of_unmeasured_points(case):
    heights = np.zeros((10, 10))
    heights[3:5, 3:9] = math.nan
    surface = make_surface(heights, 1e-3, file="a.plu")
    check_unmeasured(surface, 0.12)
    with pytest.raises(InputError, match=r"a\.plu: 12 % .*\(12 of 100\).* limit of 10 %"):
        check_unmeasured(surface, 0.1)
    with pytest.raises(InputError, match="100 % of the points are unmeasured"):
        prepare_scan(case[3] * math.nan, **SETTINGS)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 8), st.integers(1, 7), st.integers(0, 10_000))
def test_filling_is_exact_on_planes(seeds, width, seed):
    rng = np.random.default_rng(seed)
    holes = np.zeros((30, 25), bool)
    holes[tuple(rng.integers(0, n, seeds) for n in holes.shape)] = True
    holes = binary_dilation(holes, np.ones((width, width)))
    holes[::29, ::24] = False  # the corners are measured
    rows, columns = np.indices(holes.shape)
    plane = 5.0 + 0.03 * rows - 0.2 * columns
    filled = interpolate_holes(np.where(holes, math.nan, plane), holes)
    np.testing.assert_allclose(filled, plane, atol=1e-9)


def test_filling_without_triangles_takes_the_nearest():
    corner = np.full((6, 6), 2.0)
    corner[:2, :2] = math.nan
    assert (interpolate_holes(corner, np.isnan(corner)) == 2.0).all()
    row = np.full((3, 4), math.nan)
    row[1] = [1.0, 2.0, 3.0, 4.0]
    filled = interpolate_holes(row, np.isnan(row))
    np.testing.assert_allclose(filled, np.tile([1.0, 2, 3, 4], (3, 1)))
