"""The half-space as an operator: exact, approximate, and on some of its elements."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix

from gstlib.bem import ContactInputError, HalfSpace, Layer, contact_modulus
from gstlib.bem.halfspace import APPROXIMATION_ERROR


@pytest.mark.parametrize(
    "constants",
    [
        (1, math.nan, 1, 0.3),
        (math.inf, 0.3, math.inf, 0.3),
        ("a", 0.3, 1, 0.3),
        (1, 0.3, 1, None),
    ],
)
def test_unphysical_constants_are_refused(constants):
    with pytest.raises(ContactInputError):
        contact_modulus(*constants)


@pytest.mark.parametrize("shape", [(1, 7), (13, 8)])
@pytest.mark.parametrize("spacing", [0.05, (0.05, 0.02)])
def test_displacement_is_the_dense_sum(shape, spacing):
    pressure = np.random.default_rng(1).standard_normal(shape)
    expected = dense_matrix(shape, spacing) @ pressure.ravel()
    displacement = HalfSpace(shape, spacing, MODULUS).displacement(pressure)
    within = 1e-13 * abs(expected).max()
    np.testing.assert_allclose(displacement, expected.reshape(shape), atol=within)


@pytest.mark.parametrize("layer", [None, Layer(50.0, 0.4, 0.02)])
@pytest.mark.parametrize("periodic", [False, True])
def test_springs_give_way_to_the_pressure_on_them_its_mean_included(periodic, layer):
    pressure = np.random.default_rng(1).random((9, 12))
    options = {"layer": layer, "periodic": periodic}
    stiff = HalfSpace(pressure.shape, 0.01, MODULUS, **options)
    soft = HalfSpace(pressure.shape, 0.01, MODULUS, springs=3e-6, **options)
    added = soft.displacement(pressure) - stiff.displacement(pressure)
    np.testing.assert_allclose(added, 3e-6 * pressure, atol=1e-15)


@pytest.mark.parametrize(
    ("shape", "spacing"),
    [((33, 70), 0.01), ((300, 257), 0.01), ((400, 220), (0.01, 0.02))],
)
def test_approximate_displacement_has_the_stated_error(shape, spacing):
    half_space = HalfSpace(shape, spacing, MODULUS)
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(shape)
    sparse = rng.exponential(1.0, shape) * (rng.random(shape) < 0.03)
    for pressure in (noise, sparse, np.ones(shape)):
        exact = half_space.displacement(pressure)
        single = half_space.approximate_displacement(pressure.astype(np.float32))
        assert single.dtype == np.float32
        assert abs(single - exact).max() <= APPROXIMATION_ERROR * abs(exact).max()
    assert half_space.convolutions == 6
