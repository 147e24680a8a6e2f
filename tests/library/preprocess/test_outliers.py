"""Outliers: the paper's rule, never more than the share, and spikes are found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from gstlib.preprocess.outliers import deviation_ratio, replace_outliers
from gstlib.surface import make_surface


def rough(seed=0, size=64, smoothing=2.0):
    return gaussian_filter(np.random.default_rng(seed).normal(size=(size, size)), smoothing) * 1e-2


def test_ratio_is_the_rule_as_written():
    heights = rough(1, size=15) + 50.0
    r = 2
    ratio = deviation_ratio(heights, r)
    padded = np.pad(heights, r, mode="symmetric")
    for i, j in [(7, 7), (0, 0), (3, 14), (14, 1)]:
        window = padded[i : i + 2 * r + 1, j : j + 2 * r + 1]
        expected = abs(heights[i, j] - window.mean()) / window.std()
        assert ratio[i, j] == pytest.approx(expected, rel=1e-6)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 0.1), st.integers(1, 6))
def test_never_more_than_the_share(seed, share, half_width):
    surface = make_surface(rough(seed), 1e-3)
    clean, outlier, k = replace_outliers(surface, half_width=half_width, share=share)
    allowed = share * surface.size
    assert int(outlier.sum()) <= allowed
    assert int(outlier.sum()) > allowed - 2  # and no fewer than need be
    assert k >= 0
    np.testing.assert_array_equal(clean.values[~outlier.values], surface.values[~outlier.values])


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 1000), st.floats(0, 0.2), st.floats(0, 0.2))
def test_threshold_falls_as_the_share_grows(seed, share, other):
    surface = make_surface(rough(seed, size=32), 1e-3)
    few, many = sorted((share, other))
    found = [replace_outliers(surface, half_width=3, share=s) for s in (few, many)]
    assert found[0][2] >= found[1][2]
    assert not (found[0][1] & ~found[1][1]).any()  # the fewer are among the more


def test_share_of_nothing_leaves_all():
    surface = make_surface(rough(), 1e-3)
    clean, outlier, _ = replace_outliers(surface, half_width=5, share=0.0)
    assert not outlier.any()
    np.testing.assert_array_equal(clean.values, surface.values)


@pytest.mark.parametrize("offset", [0.0, 76.3])  # some instruments count from far away
def test_flat_surface_has_none(offset):
    surface = make_surface(np.full((40, 40), offset), 1e-3)
    _, outlier, k = replace_outliers(surface, half_width=5, share=0.01)
    assert not outlier.any()
    assert k == 0


def test_smooth_surface_hardly_changes():
    heights = rough(smoothing=6.0)
    clean, _, _ = replace_outliers(make_surface(heights, 1e-3), half_width=5, share=0.01)
    assert np.abs(clean.values - heights).max() < 0.2 * heights.std()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_planted_spikes_are_found_whatever_the_tilt(seed, tilt_y, tilt_x):
    rng = np.random.default_rng(seed)
    truth = rough(seed, size=96) + 40.0
    rows, columns = np.indices(truth.shape)
    truth = truth + 1e-3 * (tilt_y * rows + tilt_x * columns)
    spikes = np.zeros(truth.shape, bool)
    # Spikes of one to four points, apart from each other.
    for i, j in 12 * rng.permutation(64)[:15, None] % [96, 1] + [0, 0]:
        row, column = 4 + i, 4 + 12 * (int(j) // 96 % 8)
        spikes[row : row + rng.integers(1, 3), column : column + rng.integers(1, 3)] = True
    sign = rng.choice([-1.0, 1.0], size=truth.shape)
    surface = make_surface(truth + 0.05 * sign * spikes, 1e-3)
    clean, outlier, _ = replace_outliers(surface, half_width=5, share=0.02)
    assert outlier.values[spikes].all()
    assert np.abs(clean.values - truth)[spikes].max() < 0.01


def test_cluster_that_fills_its_window_is_out_of_reach():
    # What the module's docstring says of the window's width.
    heights = np.zeros((64, 64))
    heights[30:35, 30:35] = 1.0
    narrow, wide = (deviation_ratio(heights, r)[32, 32] for r in (3, 10))
    assert narrow == pytest.approx(np.sqrt((49 - 25) / 25))
    assert wide == pytest.approx(np.sqrt((441 - 25) / 25))
