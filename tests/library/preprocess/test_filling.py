"""Filling: linear where it is surrounded, local, and only up to a limit."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import binary_dilation, gaussian_filter

from gstlib.errors import InputError
from gstlib.preprocess.filling import fill_unmeasured, interpolate_holes
from gstlib.surface import make_surface


def blobs(shape, seeds, width, seed):
    """Clusters of holes that leave the corners of the map measured."""
    holes = np.zeros(shape, bool)
    rng = np.random.default_rng(seed)
    holes[tuple(rng.integers(0, n, seeds) for n in shape)] = True
    holes = binary_dilation(holes, np.ones((width, width)))
    holes[:: shape[0] - 1, :: shape[1] - 1] = False
    return holes


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 8), st.integers(1, 7), st.integers(0, 10_000))
def test_exact_on_planes(seeds, width, seed):
    holes = blobs((30, 25), seeds, width, seed)
    rows, columns = np.indices(holes.shape)
    plane = 5.0 + 0.03 * rows - 0.2 * columns
    filled = interpolate_holes(np.where(holes, math.nan, plane), holes)
    np.testing.assert_allclose(filled, plane, atol=1e-9)


def test_far_points_do_not_matter():
    heights = np.random.default_rng(0).normal(size=(40, 40))
    holes = np.zeros(heights.shape, bool)
    holes[5:8, 5:9] = holes[30:33, 20:28] = holes[0:2, 30:33] = True
    filled = interpolate_holes(heights, holes)
    fence = binary_dilation(holes, np.ones((3, 3)))
    disturbed = interpolate_holes(np.where(fence, heights, 1e6), holes)
    np.testing.assert_allclose(disturbed[holes], filled[holes])


def test_hole_in_a_corner_takes_the_nearest():
    heights = np.full((6, 6), 2.0)
    heights[:2, :2] = math.nan
    assert (interpolate_holes(heights, np.isnan(heights)) == 2.0).all()


def test_one_row_left():
    heights = np.full((3, 4), math.nan)
    heights[1] = [1.0, 2.0, 3.0, 4.0]
    filled = interpolate_holes(heights, np.isnan(heights))
    np.testing.assert_allclose(filled, np.tile([1.0, 2, 3, 4], (3, 1)))


def test_measured_points_stay_and_are_told_from_filled_ones():
    rough = gaussian_filter(np.random.default_rng(1).normal(size=(64, 64)), 2)
    holes = blobs(rough.shape, 10, 3, seed=1)
    surface = make_surface(np.where(holes, math.nan, rough), 1e-3, file="a.plu")
    whole, filled = fill_unmeasured(surface, maximum_share=0.1)
    np.testing.assert_array_equal(filled.values, holes)
    np.testing.assert_array_equal(whole.values[~holes], rough[~holes])
    assert np.isfinite(whole.values).all()
    assert whole.attrs["file"] == "a.plu"


def test_limit():
    heights = np.zeros((10, 10))
    heights[3:5, 3:9] = math.nan
    surface = make_surface(heights, 1e-3, file="a.plu")
    fill_unmeasured(surface, maximum_share=0.12)
    with pytest.raises(InputError, match=r"a\.plu: 12 % .*\(12 of 100\).* limit of 10 %"):
        fill_unmeasured(surface, maximum_share=0.1)


def test_nothing_measured():
    surface = make_surface(np.full((4, 4), math.nan), 1e-3)
    with pytest.raises(InputError, match="not one point"):
        fill_unmeasured(surface, maximum_share=1.0)
