"""Outliers: each rule works as defined, spikes are found, and good points are left alone."""

import numpy as np
import pytest
from gstlib.preprocess import outliers
from gstlib.preprocess.outliers import median_outliers
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter

MEDIAN = {"half_width": 3, "threshold": 5.0}


def window_outliers(surface, measured=True, **settings):
    measured = np.broadcast_to(measured, surface.shape)
    return outliers.window_outliers(surface, measured=measured, **settings)


def rough(seed=0, size=64, smoothing=2.0):
    return gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), smoothing) * 1e-2


def spiky(seed, size=96):
    """A rough face with spikes of one to nine points, apart from each other."""
    rng = np.random.default_rng(seed)
    truth = rough(seed, size) + 40.0
    spikes = np.zeros(truth.shape, bool)
    places = rng.permutation((size // 12) ** 2)[:15]
    for row, column in 12 * np.array(np.divmod(places, size // 12)).T + rng.integers(0, 9, (15, 2)):
        spikes[row : row + rng.integers(1, 4), column : column + rng.integers(1, 4)] = True
    sign = rng.choice([-1.0, 1.0], size=truth.shape)
    return make_surface(truth + 0.05 * sign * spikes, 1e-3), spikes


def windows(heights, r, mode):
    """The points around each point, (points, points of a window)."""
    padded = np.pad(heights, r, mode=mode)
    return sliding_window_view(padded, 2 * (2 * r + 1,)).reshape(heights.size, -1)


def test_window_rule_is_the_rule_as_written():
    surface = make_surface(rough(1, size=15) + 50.0, 1e-3)
    heights, r = remove_plane(surface)[0].values, 2
    around = windows(heights, r, "symmetric")
    deviations = abs(heights.ravel() - around.mean(axis=1)) / around.std(axis=1)
    outlier, k = window_outliers(surface, half_width=r, share=0.1)
    assert k == pytest.approx(np.sort(deviations)[-1 - 22], rel=1e-6)  # of 225
    np.testing.assert_array_equal(outlier.ravel(), deviations > k * (1 + 1e-6))


def test_median_rule_is_the_rule_as_written():
    """A face without a plane of its own, so that the windows can be taken as they are; smooth on
    one part and rough on another, so that the noise of the window and that of all points rule."""
    rng = np.random.default_rng(2)
    quarter = rng.standard_t(2, (12, 13)) * np.geomspace(0.1, 3.0, 13) * 1e-3
    heights = np.block([[quarter, quarter[:, ::-1]], [quarter[::-1], quarter[::-1, ::-1]]])
    r, t = 2, 3.0
    outlier, scale = median_outliers(make_surface(heights, 1e-3), half_width=r, threshold=t)
    around = windows(heights, r, "reflect")
    median = np.median(around, axis=1)
    mad = np.median(np.abs(around - median[:, None]), axis=1)
    off = np.abs(heights.ravel() - median)
    assert scale == pytest.approx(1.4826 * np.median(off), rel=1e-9)
    beyond = [off > t * 1.4826 * mad, off > t * scale]
    np.testing.assert_array_equal(outlier.ravel(), beyond[0] & beyond[1])
    assert (beyond[0] & beyond[1]).sum() > 10
    assert (beyond[0] ^ beyond[1]).sum() > 10


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 0.1), st.integers(1, 6), st.floats(0, 0.5))
def test_window_rule_takes_the_fraction_of_the_measured_points_and_no_others(
    seed, share, half_width, unmeasured
):
    surface = make_surface(rough(seed), 1e-3)
    measured = np.random.default_rng(seed).random(surface.shape) >= unmeasured
    outlier, k = window_outliers(surface, half_width=half_width, share=share, measured=measured)
    allowed = share * measured.sum()
    assert outlier.sum() <= allowed
    assert outlier.sum() > allowed - 2  # and no fewer than necessary
    assert not (outlier & ~measured).any()
    assert k >= 0


@pytest.mark.parametrize("offset", [0.0, 76.3])  # some instruments count from far away
def test_flat_surface_has_none(offset):
    surface = make_surface(np.full((40, 40), offset), 1e-3)
    outlier, k = window_outliers(surface, half_width=5, share=0.01)
    assert not outlier.any()
    assert k == 0
    assert not median_outliers(surface, **MEDIAN)[0].any()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 6))
def test_unmeasured_points_neither_are_outliers_nor_hide_any(seed, width):
    surface, spikes = spiky(seed)
    rng = np.random.default_rng(seed)
    holes = np.zeros(spikes.shape, bool)
    for row, column in np.argwhere(spikes)[rng.integers(0, spikes.sum(), 6)]:
        holes[row + 1 : row + 1 + width, max(column - width // 2, 0) : column + width // 2] = True
    outlier, _ = median_outliers(surface.where(~holes), **MEDIAN)
    assert not (outlier & holes).any()
    inner = slice(3, -3), slice(3, -3)  # at the map's rim, windows are short of points as it is
    assert outlier[inner][(spikes & ~holes)[inner]].all()
    assert (outlier & ~spikes).mean() < 1e-3
