"""Power spectra of surfaces, and the wavelengths that noise leaves."""

import numpy as np
import pytest

from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.spectrum import radial_spectrum, shortest_trusted

SPACING_MM = 2e-3
GENERATOR = np.random.default_rng(1)
NOISE = GENERATOR.standard_normal((256, 256))


def self_affine(rms_mm):
    """Heights with a power that falls as q^-3.6."""
    waves = {"hurst_exponent": 0.8, "roll_off": 256 * SPACING_MM}
    return rms_mm * self_affine_field(GENERATOR, 256, SPACING_MM, **waves)


def test_the_spectrum_of_white_noise_is_its_variance_at_every_frequency():
    noise = 1e-3 * NOISE[:, :128]
    frequency, density = radial_spectrum(noise, (SPACING_MM, 2 * SPACING_MM))
    assert frequency[-1] == pytest.approx(1 / (4 * SPACING_MM))
    # the first rings have few waves
    expected = np.var(noise) * 2 * SPACING_MM**2
    np.testing.assert_allclose(density[20:].mean(), expected, rtol=0.02)


@pytest.mark.parametrize("noise_mm", [2e-4, 5e-4, 1e-3])
def test_wavelengths_are_trusted_down_to_where_noise_has_as_much_power(noise_mm):
    heights = self_affine(3e-3)
    frequency, density = radial_spectrum(heights, (SPACING_MM, SPACING_MM))
    drowned = density < noise_mm**2 * SPACING_MM**2
    expected = 1 / frequency[np.argmax(drowned)]
    trusted = shortest_trusted(make_surface(heights + noise_mm * NOISE, SPACING_MM))
    assert expected / 2 <= trusted <= expected * 2**0.51


def test_a_scan_without_a_floor_is_trusted_to_two_points_and_noise_nowhere():
    smooth, noise = self_affine(3e-3), 1e-3 * NOISE
    assert shortest_trusted(make_surface(smooth, SPACING_MM)) == pytest.approx(4e-3)
    for nothing in (noise, noise[:6, :6]):
        assert np.isnan(shortest_trusted(make_surface(nothing, SPACING_MM)))
