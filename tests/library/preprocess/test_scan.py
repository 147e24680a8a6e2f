"""A scan through all of its preparation, and each step of it, against the stone it came from."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import binary_dilation, gaussian_filter

from gstlib.errors import InputError
from gstlib.preprocess.scans import (
    check_unmeasured,
    crop_of,
    interpolate_holes,
    prepare_patch,
    prepare_scan,
)
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

PREPROCESSING = {"maximum_unmeasured": 0.05, "outlier_fraction": 0.01}
SETTINGS = PREPROCESSING | {"mould_invert": True, "mould_flip": "x"}


@pytest.fixture
def stone():
    """Heights without a tilt of their own."""
    noise = np.random.default_rng(5).normal(size=(128, 128))
    heights = make_surface(5e-2 * gaussian_filter(noise, 4), 1e-3)
    return remove_plane(heights)[0].values


def mould_of(stone, spikes):
    """A scan of the stone's mould, with holes."""
    seen = np.where(HOLES, np.nan, stone + 0.03 * spikes)
    return make_surface(-seen[:, ::-1], 1e-3, file="a.plu")


def marked(*places):
    """A mask of points."""
    mask = np.zeros((128, 128), bool)
    for place in places:
        mask[place] = True
    return mask


SPIKES = marked(np.s_[10:120:12, 7:120:12])
HOLES = marked(np.s_[60:64, 30:40], np.s_[100:106, 80:84])


@pytest.fixture
def raw(stone):
    """Tilted, with spikes and holes."""
    rows, columns = np.indices(stone.shape)
    tilt = 1e-3 * (0.004 * rows - 0.003 * columns)
    return mould_of(stone + 0.2 + tilt, SPIKES)


@pytest.mark.parametrize("empty", [{}, {"crop_x_mm": None, "crop_y_mm": np.nan}])
def test_a_scan_is_cut_where_the_table_has_a_centre(empty):
    assert crop_of(pd.Series({"patch": "1"} | empty)) is None
    assert crop_of(pd.Series({"crop_x_mm": 2, "crop_y_mm": 1.0})) == (1.0, 2.0)
    with pytest.raises(InputError, match="crop_x_mm 2 and crop_y_mm None"):
        crop_of(pd.Series({"crop_x_mm": 2, "crop_y_mm": None}, dtype=object))


@pytest.mark.parametrize("rule", ["window", "median"])
def test_the_stone_is_recovered_and_every_step_is_counted(stone, raw, rule):
    scan = prepare_scan(raw, **SETTINGS, outlier_rule=rule)
    assert_array_equal(scan.filled, HOLES)
    assert_array_equal(scan.measured, np.float32(-raw.values[:, ::-1]))
    outlier, error = scan.outlier.values, abs(scan.height.values - stone)
    assert outlier[SPIKES & ~HOLES].all()
    assert not outlier[HOLES].any()
    # Where nothing was replaced, only the fit of the plane can differ.
    assert error[~HOLES & ~outlier].max() < 0.01 * stone.std()
    assert error[SPIKES & ~HOLES].max() < 0.2 * stone.std()
    attrs = scan.attrs
    assert attrs["unmeasured"] == attrs["filled"] == HOLES.sum()
    assert attrs["outliers"] == outlier.sum() <= 0.01 * stone.size
    tilt = attrs["tilt_y_mrad"], attrs["tilt_x_mrad"]
    assert tilt == pytest.approx((4.0, -3.0), abs=0.1)
    assert attrs["Sq_before_um"] == pytest.approx(1e3 * np.nanstd(raw.values))
    assert attrs["Sq_after_um"] == pytest.approx(1e3 * stone.std(), rel=0.01)


@pytest.mark.parametrize("rule", ["window", "median"])
def test_a_spike_beside_a_hole_does_not_spread_into_it(stone, rule):
    spikes = marked(np.s_[59, 33:36], np.s_[64, 32], np.s_[102, 84])
    scan = prepare_scan(mould_of(stone, spikes), **SETTINGS, outlier_rule=rule)
    assert scan.outlier.values[spikes].all()
    error = abs(scan.height.values - stone)
    assert error[HOLES | spikes].max() < 0.5 * stone.std()


def prepared(raw, crop, size_mm, *, flip="x", own_flip="", epoch="T0"):
    scans = {"size_mm": size_mm, "mould": {"invert": True, "flip": flip}}
    settings = {"scans": scans, "preprocessing": PREPROCESSING, "flip": own_flip}
    return prepare_patch(raw, crop=crop, epoch=epoch, **settings)


def test_a_patch_is_cut_out_of_a_scan_before_it_is_prepared(raw):
    assert prepared(raw, None, 0.128).identical(prepare_scan(raw, **SETTINGS))
    # in the scan as measured, whose columns are the stone's reversed
    heights = -np.float32(raw.values)
    piece = prepared(raw, (-0.016, 0.032), 0.064).measured
    assert_array_equal(piece, heights[16:80, 64:128][:, ::-1])
    # a patch's own flip goes before the config's; none is one, too
    flipped = {"y": heights[::-1], "none": heights, "": heights[:, ::-1]}
    for own_flip, laid in flipped.items():
        whole = prepared(raw, None, 0.128, own_flip=own_flip).measured
        assert_array_equal(whole, laid)
    with pytest.raises(InputError, match=r"a\.plu: the scan is 0\.128 × 0\.064 mm"):
        prepared(raw[:64], None, 0.064)
    # the outermost piece along y, and the next
    prepared(raw, (-0.032, 0.0), 0.064)
    with pytest.raises(InputError, match=r"y = -0\.033 mm .*0\.001 mm"):
        prepared(raw, (-0.033, 0.0), 0.064)


@pytest.mark.parametrize("flip", ["x", "y", None])
def test_a_later_scan_stays_whole_and_lies_about_its_piece(raw, flip):
    t0, t1 = (
        prepared(raw, (-0.016, 0.032), 0.064, flip=flip, epoch=epoch).measured
        for epoch in ("T0", "T1")
    )
    assert t1.shape == raw.shape
    is_inside = {axis: (t1[axis] > 0) & (t1[axis] < 0.064) for axis in "yx"}
    assert_array_equal(t1.isel(is_inside), t0)


def test_too_many_unmeasured_points_are_refused(raw):
    surface = make_surface(np.zeros((10, 10)), 1e-3, file="a.plu")
    surface[3:5, 3:9] = np.nan
    check_unmeasured(surface, 0.12)
    with pytest.raises(InputError, match=r"a\.plu: 12 %.* limit of 10 %"):
        check_unmeasured(surface, 0.1)
    with pytest.raises(InputError, match="100 % of the points are unmeasured"):
        prepare_scan(raw * np.nan, **SETTINGS | {"maximum_unmeasured": 1.0})


@pytest.mark.parametrize("name", ["mould_flip", "outlier_rule"])
def test_an_unknown_rule_is_refused(raw, name):
    with pytest.raises(InputError, match=f"{name}: is 'mean'"):
        prepare_scan(raw, **SETTINGS | {name: "mean"})


@pytest.mark.parametrize("width", range(1, 8))
def test_filling_is_exact_on_planes(width):
    lost = np.random.default_rng(width).random((30, 25)) < 0.01
    holes = binary_dilation(lost, np.ones((width, width)))
    holes[::29, ::24] = False  # the corners are measured
    rows, columns = np.indices(holes.shape)
    plane = 5.0 + 0.03 * rows - 0.2 * columns
    filled = interpolate_holes(np.where(holes, np.nan, plane), holes)
    assert_allclose(filled, plane, atol=1e-9)
