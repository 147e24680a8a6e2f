"""Surfaces in numbers, against closed forms."""

import math

import numpy as np
import pytest
from bem_reference import self_affine
from gstlib.bem import ContactInputError, measure_roughness, measure_spectrum
from gstlib.specimen.randomness import self_affine_field


@pytest.mark.parametrize(("periodic", "within"), [(True, 1e-12), (False, 1e-2)])
def test_an_egg_box_by_hand(periodic, within):
    """A cos kx cos ky: height A/2, slope Ak/√2, ∇²h = −2k²h, and the least α of 3/2."""
    n, amplitude, wavelength = 256, 1e-3, 0.25
    dy, dx = 0.5 / n, 0.5 / 192
    y, x = np.arange(n)[:, None] * dy, np.arange(192) * dx
    wave_number = 2 * math.pi / wavelength
    egg_box = amplitude * np.cos(wave_number * y) * np.cos(wave_number * x)
    found = measure_roughness(egg_box + 7.0, (dy, dx), periodic=periodic)
    expected = amplitude / 2, amplitude * wave_number / math.sqrt(2), amplitude * wave_number**2 / 2
    assert (found.height, found.slope, found.curvature) == pytest.approx(expected, rel=within)
    assert found.nayak == pytest.approx(1.5, rel=4 * within)


def test_unmeasured_heights_do_not_count_and_a_plane_does():
    surface = self_affine(128, seed=1, cut_off=16)
    whole = measure_roughness(surface, 0.01)
    holes = np.random.default_rng(0).random(surface.shape) < 0.1
    for missing in (math.nan, -math.inf):
        partial = measure_roughness(np.where(holes, missing, surface), 0.01)
        for name in ("height", "slope", "curvature"):
            assert getattr(partial, name) == pytest.approx(getattr(whole, name), rel=0.03)
    tilted = measure_roughness(surface + 0.3 * 0.01 * np.arange(128), 0.01)
    assert tilted.slope == pytest.approx(math.hypot(0.3, whole.slope), rel=1e-3)
    assert tilted.curvature == pytest.approx(whole.curvature)


def test_a_wave_has_its_power_in_its_ring_and_all_of_them_the_variance():
    n, spacing = (96, 60), (0.01, 0.02)
    y, x = (np.arange(count) * step for count, step in zip(n, spacing, strict=True))
    wave = 2e-3 * np.cos(2 * math.pi * (5 * y[:, None] / 0.96 + 3 * x / 1.2))
    table = measure_spectrum(wave + 1.0, spacing, periodic=True)
    peak = table.density_mm4.idxmax()
    q = 2 * math.pi * math.hypot(5 / 0.96, 3 / 1.2)
    assert table.wave_number_per_mm[peak] == pytest.approx(q, abs=math.pi / 0.96)
    # (a/2)² A of each of two waves
    power = table.density_mm4[peak] * table.waves[peak]
    assert power == pytest.approx(2 * 1e-3**2 * 0.96 * 1.2)
    heights = np.random.default_rng(0).normal(size=n)
    table = measure_spectrum(heights, spacing, periodic=True)
    power = (table.density_mm4 * table.waves).sum() / (0.96 * 1.2)
    assert power == pytest.approx(heights.var(), rel=1e-12)
    assert table.waves.sum() == heights.size - 1


def test_a_piece_has_the_spectrum_of_its_surface():
    """C falls as q^(−2(1 + H))."""
    waves = {"hurst_exponent": 0.8, "roll_off": 1.0, "shortest": 0.02}
    whole = self_affine_field(np.random.default_rng(1), 512, 1 / 256, **waves)
    tables = (
        measure_spectrum(whole, 1 / 256, periodic=True),
        measure_spectrum(whole[:256, :256], 1 / 256),
    )
    for table in tables:
        table = table[table.wave_number_per_mm.between(50, 250)]
        slope, _ = np.polyfit(np.log(table.wave_number_per_mm), np.log(table.density_mm4), 1)
        assert slope == pytest.approx(-2 * 1.8, abs=0.1)
    both = [np.interp(100.0, of.wave_number_per_mm, of.density_mm4) for of in tables]
    assert both[1] == pytest.approx(both[0], rel=0.3)
    with pytest.raises(ContactInputError):
        measure_spectrum(np.where(whole > 0, whole, np.nan), 1 / 256)
