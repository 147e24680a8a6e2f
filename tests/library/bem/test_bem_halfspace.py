import numpy as np
import pytest
from bem_reference import dense_matrix

from gstlib.bem import HalfSpace, InvalidContactInput
from gstlib.bem.convolution import Crew
from gstlib.bem.elasticity import LoveKernel, love_kernel
from gstlib.bem.splitting import SplitConvolution
from gstlib.bem.window import APPROXIMATION_ERROR, Window

SHAPES = [(1, 1), (1, 7), (6, 1), (5, 5), (13, 8), (9, 17), (16, 16)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("spacing", [0.05, (0.05, 0.02)])
def test_displacement_is_the_dense_sum(shape, spacing):
    pressure = np.random.default_rng(1).standard_normal(shape)
    expected = dense_matrix(shape, spacing) @ pressure.ravel()
    displacement = HalfSpace(shape, spacing, 12820.0).displacement(pressure)
    assert displacement.shape == shape
    np.testing.assert_allclose(displacement.ravel(), expected, atol=1e-13 * abs(expected).max())


def test_not_periodic():
    pressure = np.zeros((32, 32))
    pressure[16, 0] = 1
    displacement = HalfSpace((32, 32), 0.1, 1.0).displacement(pressure)
    assert np.all(np.diff(displacement[16]) < 0)


@pytest.mark.parametrize("share", [0, 1], ids=["whole grid", "window"])
@pytest.mark.parametrize("shape", [(64, 64), (200, 131), (20, 400), (257, 300)])
@pytest.mark.usefixtures("always_threads")
def test_same_bits_for_any_number_of_workers(shape, share):
    rng = np.random.default_rng(2)
    pressure = rng.random(shape)
    some = rng.random(shape) < 0.1
    some[:, : share * shape[1] // 2] = False
    elements = np.flatnonzero(some)
    results = []
    for workers in (1, 2, 3):
        half_space = HalfSpace(shape, 0.1, 1.0, workers)
        window = Window(half_space, elements)
        values = pressure.reshape(-1)[elements]
        fields = (
            half_space.displacement(pressure),
            window.exact_displacement(values),
            window.displacement(values),
            window.pressure(values),
        )
        results.append([field.tobytes() for field in fields])
    assert results[0] == results[1] == results[2]


def test_counts_convolutions_and_leaves_its_input_alone():
    half_space = HalfSpace((8, 8), 0.1, 1.0)
    pressure = np.ones((8, 8))
    half_space.displacement(pressure)
    half_space.displacement(pressure)
    assert half_space.convolutions == 2
    assert np.all(pressure == 1)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (24, 30), (30, 24)])
@pytest.mark.parametrize("spacing", [0.05, (0.05, 0.15)])
def test_approximate_inverse_is_close_and_positive_definite(shape, spacing):
    matrix = dense_matrix(shape, spacing)
    half_space = HalfSpace(shape, spacing, 12820.0)
    units = np.eye(matrix.shape[0]).reshape(-1, *shape)
    columns = [half_space.approximate_inverse(unit).ravel().copy() for unit in units]
    approximate = np.array(columns)
    # In single precision.
    np.testing.assert_allclose(approximate, approximate.T, atol=1e-6 * abs(approximate).max())
    eigenvalues = np.linalg.eigvals(approximate @ matrix).real
    # The whole grid in contact is the hardest case: its borders are what the inverse ignores.
    assert eigenvalues.min() > 0.5
    assert eigenvalues.max() < 40


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
    half_space = HalfSpace(shape, spacing, 12820.0)
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


def test_split_kernel_is_used_where_it_saves():
    assert SplitConvolution.saves((300, 257), (0.01, 0.01))
    assert SplitConvolution.saves((2048, 2048), (0.01, 0.01))
    assert not SplitConvolution.saves((64, 64), (0.01, 0.01))
    # Along y this margin would be longer than the grid.
    assert not SplitConvolution.saves((300, 300), (0.001, 0.01))


def test_split_kernel_has_no_far_images():
    """A load at one corner is felt at the other as on an unbounded half-space."""
    shape, spacing = (260, 300), (0.01, 0.01)
    displacement = SplitConvolution(shape, LoveKernel(spacing, 1000.0, (1, 1)), Crew(1))
    for load, place in (((0, 0), (-1, -1)), ((-1, 0), (0, -1)), ((130, -1), (130, 0))):
        pressure = np.zeros(shape, np.float32)
        pressure[load] = 1.0
        rows, columns = (abs(load[axis] % n - place[axis] % n) for axis, n in enumerate(shape))
        expected = love_kernel((rows + 1, columns + 1), spacing, 1000.0)[rows, columns]
        largest = love_kernel((1, 1), spacing, 1000.0)[0, 0]
        assert displacement(pressure)[place] == pytest.approx(expected, abs=5e-7 * largest)


def test_window_is_the_whole_grid_seen_by_its_elements():
    half_space = HalfSpace((40, 60), (0.05, 0.03), 12820.0)
    rng = np.random.default_rng(5)
    for box in ((slice(5, 20), slice(30, 50)), (slice(8, 18), slice(32, 44)), np.s_[:, :]):
        mask = np.zeros(half_space.shape, bool)
        mask[box] = rng.random(mask[box].shape) < 0.5
        elements = np.flatnonzero(mask)
        pressure = np.zeros(half_space.shape)
        pressure[mask] = rng.random(elements.size)
        expected = half_space.displacement(pressure)[mask]
        window = Window(half_space, elements)
        before = half_space.convolutions
        np.testing.assert_allclose(
            window.exact_displacement(pressure[mask]), expected, atol=1e-13 * expected.max()
        )
        single = window.displacement(pressure[mask])
        assert abs(single - expected).max() <= APPROXIMATION_ERROR * expected.max()
        assert half_space.convolutions == before + 2
    assert half_space.window((10, 12)).shape == (10, 12)
    assert half_space.window((10, 11)).shape == (10, 12)  # the last one will do
    assert half_space.window((39, 60)) is half_space


@pytest.mark.parametrize(
    ("shape", "spacing", "modulus", "workers"),
    [
        ((0, 3), 0.1, 1.0, 1),
        ((3,), 0.1, 1.0, 1),
        ("ab", 0.1, 1.0, 1),
        ((3, 3), 0.0, 1.0, 1),
        ((3, 3), (0.1, -0.1), 1.0, 1),
        ((3, 3), np.nan, 1.0, 1),
        ((3, 3), "a", 1.0, 1),
        ((3, 3), (1, 1, 1), 1.0, 1),
        ((3, 3), 0.1, 0.0, 1),
        ((3, 3), 0.1, np.inf, 1),
        ((3, 3), 0.1, None, 1),
        ((3, 3), 0.1, 1.0, 0),
        ((3, 3), 0.1, 1.0, 1.5),
    ],
)
def test_bad_input_is_refused(shape, spacing, modulus, workers):
    with pytest.raises(InvalidContactInput):
        HalfSpace(shape, spacing, modulus, workers)


def test_pressure_of_another_shape_is_refused():
    with pytest.raises(InvalidContactInput, match=r"\(3, 4\)"):
        HalfSpace((4, 3), 0.1, 1.0).displacement(np.zeros((3, 4)))
