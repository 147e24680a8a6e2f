"""Shifts over a torus, drawn apart for the seam: claims as often as the level says."""

import numpy as np
import pytest

from gstlib.specimen.randomness import smooth_field
from gstlib.validation.seam import seam_factor

SIDE, LEVEL = 48, 0.05


def p_values(pairs, length):
    """P-values of two unrelated smooth fields on a window, plain and drawn apart."""
    valid = np.ones((SIDE, SIDE), dtype=bool)
    found = []
    for number in range(pairs):
        one, other = (
            smooth_field(np.random.default_rng([number, k]), 4 * SIDE, 1.0, length)[:SIDE, :SIDE]
            for k in range(2)
        )
        moved, fixed = one.astype(float), (other > np.quantile(other, 0.8)).astype(float)
        sums = np.fft.irfft2(np.conj(np.fft.rfft2(moved)) * np.fft.rfft2(fixed), moved.shape)
        apart = sums.mean() + seam_factor(moved, fixed, valid) * (sums - sums.mean())
        found.append([(values >= sums[0, 0] - 1e-9).mean() for values in (sums, apart)])
    return np.array(found)


def test_claims_come_as_often_as_the_level_says():
    pairs = 500
    error = 3 * np.sqrt(LEVEL * (1 - LEVEL) / pairs)
    plain, apart = (p_values(pairs, 20.0) <= LEVEL).mean(axis=0)
    assert plain > LEVEL + error
    assert apart < LEVEL + error


def test_small_waves_have_no_seam():
    rng = np.random.default_rng(1)
    moved, fixed = (rng.random((SIDE, SIDE)) > 0.9 for _ in range(2))
    assert seam_factor(moved, fixed, np.ones((SIDE, SIDE), dtype=bool)) == pytest.approx(1, abs=0.1)


def test_nothing_to_compare_is_left_as_it_is():
    mask = np.ones((SIDE, SIDE), dtype=bool)
    assert seam_factor(mask, mask, mask) == 1
    assert seam_factor(mask, mask, ~mask) == 1
