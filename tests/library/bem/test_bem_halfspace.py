"""The half-space as an operator: exact, approximate, and on some of its elements."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix
from gstlib.bem import ContactInputError, HalfSpace, Layer, contact_modulus
from gstlib.bem.halfspace import APPROXIMATION_ERROR


def test_contact_modulus():
    # SCIENCE.md section 3: 10.35 GPa by the standard definition.
    assert contact_modulus(19500, 0.24, 19500, 0.24) == pytest.approx(10346, abs=1)
    assert contact_modulus(200e3, 0.3, math.inf, 0.0) == pytest.approx(200e3 / 0.91)


@pytest.mark.parametrize(
    "constants",
    [(0, 0.3, 1, 0.3), (1, 0.6, 1, 0.3), (1, math.nan, 1, 0.3), (math.inf, 0.3, math.inf, 0.3)],
)
def test_unphysical_constants_are_refused(constants):
    with pytest.raises(ContactInputError):
        contact_modulus(*constants)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (6, 1), (13, 8), (9, 17), (16, 16)])
@pytest.mark.parametrize("spacing", [0.05, (0.05, 0.02)])
def test_displacement_is_the_dense_sum(shape, spacing):
    pressure = np.random.default_rng(1).standard_normal(shape)
    expected = dense_matrix(shape, spacing) @ pressure.ravel()
    displacement = HalfSpace(shape, spacing, MODULUS).displacement(pressure)
    assert displacement.shape == shape
    np.testing.assert_allclose(displacement.ravel(), expected, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize("layer", [None, Layer(50.0, 0.4, 0.02)])
@pytest.mark.parametrize("periodic", [False, True])
def test_springs_give_way_to_the_pressure_on_them_its_mean_included(periodic, layer):
    pressure = np.random.default_rng(1).random((9, 12))
    stiff, soft = (
        HalfSpace(pressure.shape, 0.01, MODULUS, springs=springs, layer=layer, periodic=periodic)
        for springs in (0.0, 3e-6)
    )
    given = soft.displacement(pressure) - stiff.displacement(pressure)
    np.testing.assert_allclose(given, 3e-6 * pressure, atol=1e-15)


@pytest.mark.parametrize(
    ("shape", "spacing"),
    [
        ((1, 1), 0.01),
        ((33, 70), 0.01),
        ((256, 256), 0.01),
        ((300, 257), 0.01),
        ((400, 220), (0.01, 0.02)),
        ((512, 512), (0.02, 0.015)),
    ],
)
def test_approximate_displacement_has_the_stated_error(shape, spacing):
    half_space = HalfSpace(shape, spacing, MODULUS)
    rng = np.random.default_rng(4)
    for pressure in (
        rng.standard_normal(shape),
        rng.exponential(1.0, shape) * (rng.random(shape) < 0.03),
        np.ones(shape),
    ):
        exact = half_space.displacement(pressure)
        single = half_space.approximate_displacement(pressure.astype(np.float32))
        assert single.dtype == np.float32
        assert abs(single - exact).max() <= APPROXIMATION_ERROR * abs(exact).max()
    assert half_space.convolutions == 6


@pytest.mark.parametrize(
    ("shape", "spacing", "modulus"),
    [((0, 3), 0.1, 1.0), ((3, 3), (0.1, -0.1), 1.0), ((3, 3), 0.1, np.inf), ((3, 3), 0.1, None)],
)
def test_bad_input_is_refused(shape, spacing, modulus):
    with pytest.raises(ContactInputError):
        HalfSpace(shape, spacing, modulus)
