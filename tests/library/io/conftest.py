"""Heights that the formats of scans hold."""

import math

import numpy as np
import pytest


@pytest.fixture
def heights():
    """Not square, odd, and no symmetry: every mistake of axes shows."""
    heights = 1e-3 * np.random.default_rng(1).normal(size=(5, 7))
    heights[1, 5] = math.nan
    return heights
