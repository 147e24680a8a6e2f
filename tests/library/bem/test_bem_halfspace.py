"""The half-space as an operator: exact, approximate, and on some of its elements."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine
from gstlib.bem import ContactInputError, HalfSpace, Layer, contact_modulus, solve_contact
from gstlib.bem.convolution import SplitConvolution, love_kernel
from gstlib.bem.halfspace import APPROXIMATION_ERROR
from gstlib.bem.window import Window


def test_contact_modulus():
    # SCIENCE.md section 3: 10.35 GPa by the standard definition.
    assert contact_modulus(19500, 0.24, 19500, 0.24) == pytest.approx(10346, abs=1)
    assert contact_modulus(200e3, 0.3, math.inf, 0.0) == pytest.approx(200e3 / 0.91)


@pytest.mark.parametrize(
    "constants",
    [
        (0, 0.3, 1, 0.3),
        (1, 0.6, 1, 0.3),
        (1, 0.3, 1, -1),
        (math.nan, 0.3, 1, 0.3),
        (1, math.nan, 1, 0.3),
        (math.inf, 0.3, math.inf, 0.3),
    ],
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


def test_split_kernel_has_no_far_images():
    """A load at one corner is felt at the other as on an unbounded half-space."""
    shape, spacing = (260, 300), (0.01, 0.01)
    displacement = SplitConvolution(
        shape, spacing, 1000.0, HalfSpace(shape, spacing, 1000.0).kernel
    )
    for load, place in (((0, 0), (-1, -1)), ((-1, 0), (0, -1)), ((130, -1), (130, 0))):
        pressure = np.zeros(shape, np.float32)
        pressure[load] = 1.0
        rows, columns = (abs(load[axis] % n - place[axis] % n) for axis, n in enumerate(shape))
        expected = love_kernel((rows + 1, columns + 1), spacing, 1000.0)[rows, columns]
        largest = love_kernel((1, 1), spacing, 1000.0)[0, 0]
        assert displacement(pressure)[place] == pytest.approx(expected, abs=5e-7 * largest)


def test_window_is_the_whole_grid_as_its_elements_feel_it():
    half_space = HalfSpace((80, 90), (0.05, 0.03), MODULUS)
    rng = np.random.default_rng(5)
    boxes = []
    for box in (np.s_[5:55, 30:80], np.s_[8:56, 32:80], np.s_[:, :]):
        mask = np.zeros(half_space.shape, bool)
        mask[box] = rng.random(mask[box].shape) < 0.5
        pressure = np.zeros(half_space.shape)
        pressure[mask] = rng.random(np.count_nonzero(mask))
        expected = half_space.displacement(pressure)[mask]
        window = Window(half_space, np.flatnonzero(mask))
        boxes.append(window._box)
        before = half_space.convolutions
        np.testing.assert_allclose(
            window.exact_displacement(pressure[mask]), expected, atol=1e-13 * expected.max()
        )
        single = window.displacement(pressure[mask])
        assert abs(single - expected).max() <= APPROXIMATION_ERROR * expected.max()
        assert half_space.convolutions == before + 2
    # The half-space on a box is made once, and not for nearly the whole grid.
    assert boxes[0] is boxes[1] is not half_space
    assert boxes[2] is half_space


@pytest.mark.parametrize(("seed", "mean_pressure"), [(1, 20.0), (2, 60.0), (3, 200.0), (4, 1000.0)])
def test_preconditioner_is_definite_and_better_than_the_short_range_alone(seed, mean_pressure):
    n = 64
    heights = self_affine(n, seed=seed, roll_off=0.1)
    contact = solve_contact(heights, 0.85 / n, MODULUS, mean_pressure=mean_pressure).contact
    matrix = dense_matrix(contact.shape, 0.85 / n)[np.ix_(contact.ravel(), contact.ravel())]
    preconditioner = Window(
        HalfSpace(contact.shape, 0.85 / n, MODULUS), np.flatnonzero(contact)
    ).preconditioner
    preconditioner.fit(np.ones(len(matrix), bool))
    units = np.eye(len(matrix))
    full = np.array([preconditioner(unit) for unit in units])
    short = np.array([preconditioner.short_range(unit) for unit in units])
    np.testing.assert_allclose(full, full.T, atol=1e-6 * full.max())
    np.testing.assert_allclose(preconditioner.uniform, full.sum(axis=0), rtol=1e-3)
    conditions = []
    for inverse in (full, short):
        factor = np.linalg.cholesky(0.5 * (inverse + inverse.T))  # raises if not definite
        eigenvalues = np.linalg.eigvalsh(factor.T @ matrix @ factor)
        conditions.append(eigenvalues.max() / eigenvalues.min())
    assert conditions[0] < 0.7 * conditions[1]
    assert conditions[0] < 8


@pytest.mark.parametrize(
    ("shape", "spacing", "modulus"),
    [
        ((0, 3), 0.1, 1.0),
        ((3,), 0.1, 1.0),
        ((3, 3), 0.0, 1.0),
        ((3, 3), (0.1, -0.1), 1.0),
        ((3, 3), np.nan, 1.0),
        ((3, 3), "a", 1.0),
        ((3, 3), 0.1, 0.0),
        ((3, 3), 0.1, np.inf),
        ((3, 3), 0.1, None),
    ],
)
def test_bad_input_is_refused(shape, spacing, modulus):
    with pytest.raises(ContactInputError):
        HalfSpace(shape, spacing, modulus)
