import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine, sphere

from gstlib.bem import InvalidContactInput, solve_contact
from gstlib.bem.analytic import Sphere
from gstlib.bem.topography import corrected_contact_fraction, equivalent_heights

pytestmark = pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")


def test_two_spheres_are_one_of_the_harmonic_radius():
    both = equivalent_heights(sphere(64, 0.01, 6.0), sphere(64, 0.01, 3.0))
    np.testing.assert_allclose(both, sphere(64, 0.01, 2.0), rtol=1e-13)


def test_conforming_bodies_are_flat():
    rough = self_affine(16)
    assert np.ptp(equivalent_heights(rough, -rough)) == 0


def test_shapes_must_agree():
    with pytest.raises(InvalidContactInput, match="upper"):
        equivalent_heights(np.zeros((3, 4)), np.zeros((4, 3)))


def test_correction_takes_off_most_of_the_first_order_error_on_hertz():
    exact = Sphere(20.0, 10.0, MODULUS)
    side = 2.6 * exact.contact_radius
    share = math.pi * exact.contact_radius**2 / side**2
    plain, corrected = [], []
    for n in range(20, 80, 3):
        spacing = side / n
        state = solve_contact(
            sphere(n, spacing, 10.0), spacing, MODULUS, mean_pressure=20.0 / side**2, tolerance=1e-7
        )
        plain.append(n * (state.contact_fraction / share - 1))
        corrected.append(n * (corrected_contact_fraction(state.contact) / share - 1))
    # Errors per element length: the mere count is too large by a first-order term, of which about a
    # third is left, with the other sign.
    left = np.mean(corrected) / np.mean(plain)
    assert np.mean(plain) > 0.3
    assert -0.5 < left < -0.2


def test_correction_converges_faster_on_a_rough_surface():
    # One smooth-cut surface sampled ever finer: what the fraction still changes by.
    fine = self_affine(256, seed=3, cut_off=32)
    plain, corrected = [], []
    for stride in (4, 2, 1):
        state = solve_contact(
            fine[::stride, ::stride], 0.85 / 256 * stride, MODULUS, mean_pressure=60.0
        )
        plain.append(state.contact_fraction)
        corrected.append(corrected_contact_fraction(state.contact))
    assert np.all(np.abs(np.diff(corrected)) < 0.6 * np.abs(np.diff(plain)))


def test_edges_are_counted_in_both_directions_and_not_at_the_border():
    mask = np.zeros((4, 5), bool)
    mask[0, 1:3] = True
    factor = (math.pi - 1 + math.log(2)) / 24
    assert corrected_contact_fraction(mask) == pytest.approx((2 - factor * 4) / 20)
    assert corrected_contact_fraction(np.ones((3, 3))) == 1
    with pytest.raises(InvalidContactInput):
        corrected_contact_fraction(np.ones(3))


def test_contact_grows_in_proportion_between_persson_and_bush():
    # Slope of contact fraction over p̄/(E* h'rms): between √(8/π) and √(2π), at a contact small
    # enough for the proportional range and with the perimeter taken off.
    n, length = 256, 0.85
    slopes = []
    for seed in (0, 1):
        heights = self_affine(n, seed=seed, cut_off=16, roll_off=0.1)
        frequency_y = 2 * np.pi * np.fft.fftfreq(n, length / n)[:, None]
        frequency_x = 2 * np.pi * np.fft.rfftfreq(n, length / n)
        spectrum = np.fft.rfft2(heights)
        gradient = math.sqrt(
            sum(
                (np.fft.irfft2(1j * q * spectrum, s=(n, n)) ** 2).mean()
                for q in (frequency_x, frequency_y)
            )
        )
        reduced = 0.02
        state = solve_contact(
            heights, length / n, MODULUS, mean_pressure=reduced * MODULUS * gradient
        )
        slopes.append(corrected_contact_fraction(state.contact) / reduced)
    assert math.sqrt(8 / math.pi) < np.mean(slopes) < math.sqrt(2 * math.pi)
