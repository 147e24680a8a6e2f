"""Moulds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gstlib.preprocess.mould import unmould
from gstlib.surface import make_surface

SURFACE = make_surface([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]], 0.1, file="a.plu")


@given(st.booleans(), st.sampled_from(["x", "y", None]))
def test_twice_is_nothing(invert, flip_axis):
    once = unmould(SURFACE, invert=invert, flip_axis=flip_axis)
    twice = unmould(once, invert=invert, flip_axis=flip_axis)
    assert twice.identical(SURFACE)


def test_the_papers_mould():
    stone = unmould(SURFACE)
    np.testing.assert_array_equal(stone.values, [[-3, -2, -1], [-6, np.nan, -4]])
    np.testing.assert_array_equal(stone.x, SURFACE.x)


def test_other_axes():
    flipped = unmould(SURFACE, invert=False, flip_axis="y")
    np.testing.assert_array_equal(flipped.values, SURFACE.values[::-1])
    with pytest.raises(ValueError, match="flip_axis"):
        unmould(SURFACE, flip_axis="z")
