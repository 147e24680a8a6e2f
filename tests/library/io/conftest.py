"""Heights that the formats of scans hold, and files with any content."""

import math

import numpy as np
import pytest


@pytest.fixture
def heights():
    """Not square, odd, and no symmetry: every mistake of axes shows."""
    heights = 1e-3 * np.random.default_rng(1).normal(size=(5, 7))
    heights[1, 5] = math.nan
    return heights


@pytest.fixture
def write(tmp_path):
    """Write a file of this name, of bytes or of text in UTF-8."""

    def write(name, content):
        is_text = isinstance(content, str)
        (tmp_path / name).write_bytes(content.encode() if is_text else content)
        return tmp_path / name

    return write
