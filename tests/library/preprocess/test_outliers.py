"""Outliers: each rule works as defined, spikes are seen, and good points are left alone."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from numpy.testing import assert_array_equal
from scipy.ndimage import binary_dilation, gaussian_filter

from gstlib.preprocess.outliers import median_outliers, window_outliers
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane


def rough(seed, size):
    noise = np.random.default_rng(seed).normal(size=(size, size))
    return 1e-2 * gaussian_filter(noise, 2.0)


def test_heights_one_step_off_are_no_outliers():
    heights = rough(3, 60).round(3)
    outlier, _ = median_outliers(
        make_surface(heights, 1e-3), half_width=3, threshold=5.0, step=1e-3
    )
    assert not outlier.any()


def windows(heights, r, mode):
    """The points around each point, (points, points of a window)."""
    padded = np.pad(heights, r, mode=mode)
    return sliding_window_view(padded, 2 * (2 * r + 1,)).reshape(heights.size, -1)


def test_window_rule_is_the_rule_as_written():
    surface, r = make_surface(rough(1, 15) + 50.0, 1e-3), 2
    measured = np.random.default_rng(1).random(surface.shape) < 0.8
    outlier, k = window_outliers(surface, half_width=r, share=0.1, measured=measured)
    heights = remove_plane(surface)[0].values
    around = windows(heights, r, "symmetric")
    off = abs(heights.ravel() - around.mean(axis=1))
    deviations = measured.ravel() * off / around.std(axis=1)
    allowed = int(0.1 * measured.sum())
    assert k == pytest.approx(np.sort(deviations)[-1 - allowed], rel=1e-6)
    assert_array_equal(outlier.ravel(), deviations > k * (1 + 1e-6))


def test_median_rule_is_the_rule_as_written():
    """Smooth on one part and rough on another, so that the noise of the window and that of all
    points rule."""
    rng = np.random.default_rng(2)
    roughness = 1e-3 * np.geomspace(0.1, 3.0, 26)
    surface = make_surface(roughness * rng.standard_t(2, (24, 26)), 1e-3)
    r, t = 2, 3.0
    outlier, scale = median_outliers(surface, half_width=r, threshold=t)
    heights = remove_plane(surface)[0].values
    around = windows(heights, r, "reflect")
    median = np.median(around, axis=1)
    mad = np.median(np.abs(around - median[:, None]), axis=1)
    off = np.abs(heights.ravel() - median)
    assert scale == pytest.approx(1.4826 * np.median(off), rel=1e-9)
    by_window, by_all = off > t * 1.4826 * mad, off > t * scale
    assert_array_equal(outlier.ravel(), by_window & by_all)
    assert (by_window & by_all).sum() > 10
    assert (by_window ^ by_all).sum() > 10


def test_unmeasured_points_neither_are_outliers_nor_hide_any():
    """Holes lie beside spikes, and fill half of their windows."""
    spikes = np.zeros((90, 90), bool)
    spikes[10::12, 10::12] = spikes[10::12, 11::12] = True
    measured = spikes | np.roll(spikes, 1, axis=0)
    holes = binary_dilation(spikes, np.ones((3, 3)), 2) & ~measured
    heights = rough(1, 90) + 40.0 + 0.05 * spikes
    surface = make_surface(heights, 1e-3).where(~holes)
    outlier, _ = median_outliers(surface, half_width=3, threshold=5.0)
    assert outlier[spikes].all()
    assert not outlier[holes].any()
    assert (outlier & ~spikes).mean() < 1e-3
