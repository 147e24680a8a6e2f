"""The rivals mark what they say they mark."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gstlib.validation.rivals import (
    contact_ranking,
    highest_points,
    mean_curvature,
    predictions,
    rigid_interpenetration,
)


@settings(deadline=None)
@given(arrays(np.int64, (4, 5), elements=st.integers(0, 6)), arrays(bool, (4, 5)), st.data())
def test_highest_points_are_highest_and_as_many(heights, valid, data):
    count = data.draw(st.integers(0, int(valid.sum())))
    mask = highest_points(heights, count, valid)
    assert mask.sum() == count
    assert not (mask & ~valid).any()
    rest = valid & ~mask
    if count and rest.any():
        assert heights[mask].min() >= heights[rest].max()


def test_of_equal_heights_the_first_are_taken():
    mask = highest_points([[1, 3, 3], [3, 0, 9]], 3)
    assert mask.tolist() == [[False, True, True], [False, False, True]]


def test_highest_points_refuses_more_than_there_are():
    with pytest.raises(ValueError, match="7 highest"):
        highest_points(np.zeros((2, 3)), 7)


def test_contact_ranks_above_nearly_touched_above_far():
    order = contact_ranking([0.0, 5.0, 0.0, 1e-9], [1e-3, 0.0, 2e-3, 0.0])
    assert list(np.argsort(order)) == [2, 0, 3, 1]
    assert list(contact_ranking([0.0, 3.0])) == [0, 3]


def test_curvature_of_a_cap_is_one_over_its_radius():
    """Sphere of radius 2 mm, on elements that are not square; a pit has the other sign."""
    spacing = (0.004, 0.006)
    y, x = (step * (np.arange(81) - 40) for step in spacing)
    cap = np.sqrt(4 - y[:, None] ** 2 - x[None, :] ** 2)
    for heights, sign in ((cap, 1), (-cap, -1)):
        curvature = mean_curvature(heights, spacing, 0.012)
        assert curvature[40, 40] == pytest.approx(sign / 2, rel=5e-3)
        # away from the summit the surface is steep: the bend alone would give 0.54
        assert curvature[25, 20] == pytest.approx(sign / 2, rel=5e-3)


def test_smoothing_takes_out_short_waves():
    x = 1e-3 * np.arange(400)
    heights = np.tile(1e-3 * np.sin(2 * np.pi * x / 0.01), (60, 1))
    rough, smooth = (
        np.abs(mean_curvature(heights, (1e-3, 1e-3), length)[:, 50:-50]).max()
        for length in (1e-3, 1e-2)
    )
    assert smooth < 1e-3 * rough


@pytest.fixture
def patch():
    heights = np.random.default_rng(0).normal(size=(30, 40))
    pressure = np.where(heights > 1.9, 7.0, 0.0)
    pressure[3, 4] = 1.0
    valid = np.ones(heights.shape, dtype=bool)
    valid[:, 33:] = False
    return heights, pressure, valid


def laid_out(patch, displacement=0.8):
    heights, pressure, valid = patch
    return predictions(
        heights,
        pressure,
        None,
        valid,
        spacing=(1e-3, 1e-3),
        displacement=displacement,
        curvature_length=2e-3,
        window=3,
    )


def test_areas_are_equal_where_scored_and_rigid_is_at_the_same_displacement(patch):
    heights, pressure, valid = patch
    found = laid_out(patch)
    area = (found["contact"].mask & valid).sum()
    assert 0 < area < (pressure > 0).sum()
    for name in ("highest", "curvature"):
        assert (found[name].mask & valid).sum() == area
        assert not found[name].mask[~valid].any()
    assert (found["rigid"].mask == (heights.max() - heights < 0.8)).all()


def test_rigid_interpenetration_at_the_area_of_the_contact_is_the_highest_points(patch):
    heights, _, _ = patch
    for count in (1, 17, 300):
        above, below = np.sort(heights.ravel())[[-count, -count - 1]]
        rigid = rigid_interpenetration(heights, heights.max() - (above + below) / 2)
        assert (rigid == highest_points(heights, count)).all()


def test_what_ranks_alike_ranks_once_and_what_is_not_known_is_left_out(patch):
    found = laid_out(patch)
    assert [name for name, one in found.items() if one.ranking is None] == ["rigid"]
    assert "rigid" not in laid_out(patch, displacement=np.nan)
