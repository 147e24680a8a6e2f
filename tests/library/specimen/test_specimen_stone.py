"""The underlying surface: its spectrum, its height, and its two parts as one surface."""

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.specimen.randomness import self_affine_field, stream
from gstlib.specimen.stone import fit_plane, make_stone

SQUARE_MM = 5.0


def radial_density(field, spacing):
    """Mean 2-D power spectral density in rings; frequencies and densities of the rings."""
    n = len(field)
    density = np.abs(scipy.fft.fft2(field)) ** 2 * spacing**2 / n**2
    frequency = np.hypot(*np.meshgrid(*[scipy.fft.fftfreq(n, spacing)] * 2))
    edges = np.geomspace(2 / (n * spacing), 0.5 / spacing, 25)
    rings = np.digitize(frequency, edges).ravel()
    count = np.bincount(rings, minlength=26)[1:25]
    total = np.bincount(rings, density.ravel(), minlength=26)[1:25]
    return np.sqrt(edges[1:] * edges[:-1]), total / np.maximum(count, 1)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.3, 0.95), st.integers(0, 2**32))
def test_spectrum_slope_gives_the_hurst_exponent(hurst, seed):
    field = self_affine_field(
        np.random.default_rng(seed), 256, 0.01, hurst_exponent=hurst, roll_off=0.5
    )
    frequency, density = radial_density(field, 0.01)
    inside = (frequency > 4) & (frequency < 40)
    slope = np.polyfit(np.log(frequency[inside]), np.log(density[inside]), 1)[0]
    assert -slope / 2 - 1 == pytest.approx(hurst, abs=0.06)


def test_density_is_flat_above_the_roll_off_and_does_not_depend_on_the_grid():
    for count, spacing in ((256, 0.02), (300, 0.013)):
        field = self_affine_field(
            np.random.default_rng(1), count, spacing, hurst_exponent=0.8, roll_off=0.5
        )
        frequency, density = radial_density(field, spacing)
        long = (frequency > 0.6) & (frequency < 1.8)
        assert density[long].mean() == pytest.approx(0.5**2, rel=0.25)


def test_nothing_is_left_outside_the_band():
    field = self_affine_field(
        np.random.default_rng(1), 128, 0.01, hurst_exponent=0.8, roll_off=1, longest=0.4,
        shortest=0.05,
    )  # fmt: skip
    power = np.abs(scipy.fft.fft2(field)) ** 2
    frequency = np.hypot(*np.meshgrid(*[scipy.fft.fftfreq(128, 0.01)] * 2))
    outside = (frequency < 0.999 / 0.4) | (frequency > 1.001 / 0.05)
    assert power[outside].max() < 1e-9 * power.max()
    assert power[~outside].min() > 0


def test_streams_differ_by_name_and_seed_only():
    draws = {
        (seed, names): tuple(stream(seed, *names).integers(0, 2**62, 2))
        for seed in (1, 2)
        for names in (("a",), ("b",), ("a", "b"), ("b", "a"))
    }
    assert len(set(draws.values())) == len(draws)
    assert tuple(stream(1, "a").integers(0, 2**62, 2)) == draws[1, ("a",)]


@pytest.fixture(scope="module")
def stone(parameters):
    return make_stone(parameters, SQUARE_MM)


def test_macroscale_part_has_the_asked_height_on_the_square(stone, parameters):
    at = np.linspace(0, SQUARE_MM, 301)
    waves = stone.waves(at[:, None] + 0 * at, at + 0 * at[:, None])
    level = waves - fit_plane(waves, at, at)[2]
    assert level.std() * 1e3 == pytest.approx(parameters.macroscale_rms_um, rel=0.02)


def test_grid_and_points_give_the_same_macroscale_surface(stone):
    y, x = np.array([-0.2, 0.37, 2.5, 5.1]), np.array([0.01, 1.234, 4.9])
    points = stone.waves(y[:, None] + 0 * x, x + 0 * y[:, None]) + stone.shape(y[:, None], x)
    np.testing.assert_allclose(stone.macroscale(y, x), points, atol=1e-7)


def test_spectrum_goes_on_across_the_cut_off(stone, parameters):
    """Densities just above and below the cut-off fit one power law."""
    cut = 1 / parameters.cut_off_wavelength_mm
    below, density_below = radial_density(stone.waviness_samples, stone.waviness_spacing)
    above, density_above = radial_density(stone.detail.astype(float), stone.spacing)
    law = -2 - 2 * parameters.hurst_exponent
    constants = [
        np.mean(density[use] / frequency[use] ** law)
        for frequency, density, use in (
            (below, density_below, (below > 0.6 * cut) & (below < 0.9 * cut)),
            (above, density_above, (above > 1.2 * cut) & (above < 6 * cut)),
        )
    ]
    assert constants[1] / constants[0] == pytest.approx(1, abs=0.25)


def test_use_face_is_slightly_concave_at_the_square(stone):
    ends = stone.shape(np.array([0, 0, 5, 5.0]), np.array([0, 5, 0, 5.0]))
    assert (ends > 0.001).all()
    assert (ends < 0.02).all()
    assert stone.shape(np.array(2.5), np.array(2.5)) == pytest.approx(0, abs=1e-12)


def test_element_means_are_means(stone):
    coarse, fine = stone.macroscale_means(10), stone.macroscale_means(40)
    np.testing.assert_allclose(
        coarse, fine.reshape(10, 4, 10, 4).mean(axis=(1, 3)), atol=3e-4, rtol=0
    )


def test_plane_of_a_plane_is_itself():
    y, x = np.arange(4.0), np.arange(7.0) * 0.5 + 3
    heights = 2 + 0.3 * y[:, None] - 0.1 * x
    slope_y, slope_x, plane = fit_plane(heights, y, x)
    assert (slope_y, slope_x) == pytest.approx((0.3, -0.1))
    np.testing.assert_allclose(plane, heights)
