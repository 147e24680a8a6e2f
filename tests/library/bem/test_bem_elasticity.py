import math

import numpy as np
import pytest
from bem_reference import influence

from gstlib.bem import InvalidContactInput, contact_modulus
from gstlib.bem.elasticity import LoveKernel, love_kernel


def test_contact_modulus_of_the_two_stones():
    # SCIENCE.md section 3: 10.35 GPa by the standard definition.
    assert contact_modulus(19500, 0.24, 19500, 0.24) == pytest.approx(19500 / (2 * (1 - 0.24**2)))
    assert contact_modulus(19500, 0.24, 19500, 0.24) == pytest.approx(10346, abs=1)


def test_rigid_body_adds_no_compliance():
    assert contact_modulus(200e3, 0.3, math.inf, 0.0) == pytest.approx(200e3 / 0.91)


@pytest.mark.parametrize(
    "constants",
    [
        (0, 0.3, 1, 0.3),
        (1, 0.3, -1, 0.3),
        (1, 0.6, 1, 0.3),
        (1, 0.3, 1, -1),
        (math.nan, 0.3, 1, 0.3),
        (1, math.nan, 1, 0.3),
        (math.inf, 0.3, math.inf, 0.3),
    ],
)
def test_unphysical_constants_are_refused(constants):
    with pytest.raises(InvalidContactInput):
        contact_modulus(*constants)


@pytest.mark.parametrize("spacing", [(0.1, 0.1), (0.1, 0.37)])
def test_love_kernel_against_johnson(spacing):
    kernel = love_kernel((9, 6), spacing, 1e4)
    for i, j in np.ndindex(kernel.shape):
        expected = influence(i * spacing[0], j * spacing[1], *spacing, 1e4)
        assert kernel[i, j] == pytest.approx(expected, rel=1e-11)


def test_love_kernel_at_the_origin_and_far_away():
    kernel = love_kernel((400, 400), (0.2, 0.2), 1.0)
    assert kernel[0, 0] * math.pi / 0.2 == pytest.approx(4 * math.asinh(1), rel=1e-14)
    # Far away an element is a point force: F/(π E* r).
    assert kernel[300, 399] == pytest.approx(0.2 / (math.pi * math.hypot(300, 399)), rel=1e-6)


@pytest.mark.parametrize("spacing", [(0.3, 0.3), (0.3, 0.17)])
def test_kernels_of_coarser_elements_are_the_same_bits(spacing):
    """Whether taken from the finest one's values or evaluated anew."""
    kernel = LoveKernel(spacing, 1e4, (33, 33))
    coarse = tuple(8 * side for side in spacing)
    for shape in ((5, 9), (33, 33), (40, 3)):
        taken = kernel.coarser(2).coarser(4).quadrant(shape)
        np.testing.assert_array_equal(taken, love_kernel(shape, coarse, 1e4))
