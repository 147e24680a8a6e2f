"""A form that was taken out of one scan alone is seen, and wear or another place is not."""

import numpy as np
import pytest
from numpy.polynomial.legendre import legvander2d

from gstlib.change.form import form_warning
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

SIZE = 96


@pytest.fixture(params=range(2))
def stone(request):
    """Self-affine heights, mm, on twice the side of a scan."""
    rng = np.random.default_rng(request.param)
    field = self_affine_field(
        rng, 2 * SIZE, 0.5 / SIZE, hurst_exponent=0.8, roll_off=1 / 3
    )
    return 5e-3 * field / field.std()


def scan(heights, corner=(48, 48), degree=1):
    """A piece of a stone without its polynomial, as software leaves it."""
    row, column = corner
    piece = heights[row : row + SIZE, column : column + SIZE].ravel()
    y, x = np.indices((SIZE, SIZE)).reshape(2, -1) / SIZE
    powers = legvander2d(y, x, [degree, degree])
    factors = np.linalg.lstsq(powers, piece, rcond=None)[0]
    level = piece - powers @ factors
    return make_surface(level.reshape(SIZE, SIZE), 1.66e-3)


def test_wear_and_another_place_are_no_doubt(stone):
    top = np.quantile(stone, 0.7)
    worn = np.where(stone > top, top + 0.1 * (stone - top), stone)
    assert form_warning(scan(stone), scan(worn, (78, 28))) is None
    assert form_warning(scan(stone), scan(0.05 * stone)) is None  # ground flat


def test_a_polynomial_taken_out_of_one_scan_is_seen(stone):
    before, after = scan(stone), scan(stone, degree=6)
    assert "T1 alone" in form_warning(before, after)
    assert "T0 alone" in form_warning(after, before)
