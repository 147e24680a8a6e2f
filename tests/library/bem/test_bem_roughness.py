"""Surfaces in numbers, against closed forms."""

import math

import numpy as np
import pytest
from bem_reference import self_affine

from gstlib.bem import measure_roughness


@pytest.mark.parametrize(("periodic", "within"), [(True, 1e-12), (False, 1e-2)])
def test_an_egg_box_by_hand(periodic, within):
    """A cos ky cos kx: height A/2, slope Ak/√2, ∇²h = −2k²h, and the least α of 3/2."""
    amplitude, wave_number = 1e-3, 8 * math.pi
    dy, dx = 0.5 / 256, 0.5 / 192
    along_y = np.cos(wave_number * dy * np.arange(256))
    along_x = np.cos(wave_number * dx * np.arange(192))
    egg_box = 7.0 + amplitude * np.outer(along_y, along_x)
    rough = measure_roughness(egg_box, (dy, dx), periodic=periodic)
    slope = amplitude * wave_number / math.sqrt(2)
    expected = amplitude / 2, slope, slope**2 / amplitude
    numbers = rough.height, rough.slope, rough.curvature
    assert numbers == pytest.approx(expected, rel=within)
    assert rough.nayak == pytest.approx(1.5, rel=4 * within)


def test_unmeasured_heights_do_not_count():
    surface = self_affine(128, seed=1, cut_off=16)
    whole = measure_roughness(surface, 0.01)
    holes = np.random.default_rng(0).random(surface.shape) < 0.1
    for missing in (math.nan, -math.inf):
        partial = measure_roughness(np.where(holes, missing, surface), 0.01)
        assert partial.curvature == pytest.approx(whole.curvature, rel=0.03)
