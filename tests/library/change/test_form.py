"""A form that was taken out of one scan alone is seen, and wear or another place is not."""

import numpy as np
import pytest
from gstlib.change.form import form_height, form_warning
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from numpy.polynomial.legendre import legvander2d

SIZE = 96


def stone(seed):
    """Self-affine heights, mm, on twice the side of a scan."""
    waves = {"hurst_exponent": 0.8, "roll_off": 1 / 3}
    heights = self_affine_field(np.random.default_rng(seed), 2 * SIZE, 0.5 / SIZE, **waves)
    return 5e-3 * heights / heights.std()


def scan(heights, at=(0, 0), degree=1):
    """A piece of a stone without its polynomial, as software leaves it."""
    first = [SIZE // 2 + shift for shift in at]
    piece = heights[first[0] : first[0] + SIZE, first[1] : first[1] + SIZE]
    y, x = np.meshgrid(*2 * [np.linspace(-1, 1, SIZE)], indexing="ij")
    powers = legvander2d(y.ravel(), x.ravel(), [degree, degree])
    keep = np.add.outer(*2 * [np.arange(degree + 1)]).ravel() <= degree
    fitted = powers[:, keep] @ np.linalg.lstsq(powers[:, keep], piece.ravel(), rcond=None)[0]
    return make_surface(piece - fitted.reshape(piece.shape), 1.66e-3)


@pytest.mark.parametrize("seed", range(4))
def test_wear_and_another_place_are_no_doubt(seed):
    heights = stone(seed)
    top = np.quantile(heights, 0.7)
    worn = np.where(heights > top, top + 0.1 * (heights - top), heights)
    assert form_warning(scan(heights), scan(worn, at=(30, -20))) is None
    assert form_warning(scan(heights, degree=8), scan(worn, degree=8)) is None  # nothing shows it
    assert form_warning(scan(heights), scan(0.05 * heights)) is None  # ground flat


@pytest.mark.parametrize("seed", range(4))
def test_a_polynomial_taken_out_of_one_scan_is_seen(seed):
    heights = stone(seed)
    before, after = scan(heights), scan(heights, degree=8)
    assert "taken out of T1 alone" in form_warning(before, after)
    assert "taken out of T0 alone" in form_warning(after, before)


def test_the_form_is_what_a_polynomial_of_degree_four_has():
    y, x = np.meshgrid(*2 * [np.linspace(-1, 1, SIZE)], indexing="ij")
    form, rest = form_height(make_surface(3e-3 * (1.5 * x**2 - 0.5) + 2 * y, 1.66e-3))
    assert form == pytest.approx(3e-3 / np.sqrt(5), rel=0.05)
    assert rest < 1e-9
