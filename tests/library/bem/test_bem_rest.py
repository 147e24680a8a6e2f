"""Contact at rest, and what tips over; the gallery has a closed form, a punch that tilts."""

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gstlib.bem import ContactInputError, Layer, solve_contact
from gstlib.bem.rest import settle


def places(shape, spacing):
    """(y, x) of the elements' centres, from the grid's corner, shape (ny, nx, 2)."""
    return (np.moveaxis(np.indices(shape), 0, -1) + 0.5) * spacing


def centre_of(pressure, spacing):
    return np.tensordot(pressure, places(pressure.shape, spacing)) / pressure.sum()


def resting(heights, spacing, force, load_point, **options):
    mean_pressure = force / (heights.size * spacing**2)
    load = {"mean_pressure": mean_pressure, "load_point": load_point}
    return solve_contact(heights, spacing, MODULUS, tolerance=1e-9, **load, **options)


@pytest.mark.parametrize("layer", [None, Layer(100.0, 0.4, 0.05)])
def test_gap_and_displacement_are_those_of_the_tilted_heights(layer):
    spacing, point = 0.01, (0.25, 0.34)
    heights = self_affine(60, seed=7, length=0.6)
    state = resting(heights, spacing, 3.0, point, layer=layer)
    tilted = heights + (places(heights.shape, spacing) - point) @ state.tilt
    options = {"mean_pressure": state.mean_pressure, "layer": layer, "tolerance": 1e-9}
    fixed = solve_contact(tilted, spacing, MODULUS, **options)
    assert fixed.displacement == pytest.approx(state.displacement, rel=1e-8)
    assert_allclose(fixed.gap, state.gap, atol=1e-8 * state.displacement)
    away = centre_of(state.pressure, spacing) - point
    assert np.hypot(*away) / 0.6 < 1e-9


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 24),
    st.integers(1, 24),
    st.floats(1e-7, 1.0),
)
def test_any_surface_comes_to_rest_under_a_force_within_it(seed, ny, nx, mean_pressure):
    rng, shape = np.random.default_rng(seed), (ny, nx)
    heights, spacing = 1e-4 * rng.standard_normal(shape), rng.uniform(0.01, 0.1, 2)
    heights[rng.random(shape) < rng.uniform(0, 0.9)] = -np.inf
    heights[rng.integers(ny), rng.integers(nx)] = 0.0
    heights += places(shape, spacing) @ rng.uniform(-0.2, 0.2, 2)
    surface = np.isfinite(heights)
    point = centre_of(surface * rng.exponential(size=shape) ** 4, spacing)
    options = {"mean_pressure": mean_pressure, "tolerance": 1e-8}
    state = solve_contact(heights, spacing, MODULUS, load_point=point, **options)
    assert max(state.residual, state.moment_residual) <= 1e-8
    assert not state.pressure[~surface].any()
    assert np.all(np.isposinf(state.gap[~surface]))
    distance = np.hypot(*(centre_of(state.pressure, spacing) - point))
    assert distance <= 1.1e-8 * max(shape * spacing)


@pytest.mark.parametrize("count", [830, 1500])
def test_a_point_is_inside_on_grids_of_any_size(count):
    """Places all over a disc and at its top are; 1e-5 elements beyond is not."""
    middle = (count - 1) / 2
    y, x = np.indices((count, count)) - middle
    flat = np.where(np.hypot(y, x) > middle + 1, -np.inf, 0.0)
    shares = np.random.default_rng(count).uniform(-0.7, 0.7, (5, 2))
    for share in (*shares, np.array([-1, 0])):
        place, *_ = settle(flat, middle + share * middle)
        assert_allclose(place, middle + share * middle, atol=1e-9)
    assert settle(flat, np.array([-1e-5, middle])) is None


def test_no_force_leaves_the_rigid_rest():
    heights = np.full((9, 9), -1.0)
    heights[1, 1], heights[7, 1], heights[1, 7] = 0.0, 0.03, 0.06
    state = resting(heights, 0.1, 0.0, (0.35, 0.35))
    assert_allclose(state.tilt, (-0.05, -0.1), atol=1e-12)


RIM = np.zeros((10, 10))
RIM[:, 6:] = -np.inf
POINT = 0.5, 0.3


@pytest.mark.parametrize(
    ("heights", "point", "message"),
    [
        (RIM, (0.5, 0.7), r"\(0.5, 0.7\) mm"),
        (RIM, (0.5, np.nan), "load_point"),
        (np.full((3, 3), -np.inf), POINT, "no surface"),
        (np.diag([5.0] + [0.0] * 9), POINT, "45°"),
        (0.2 * np.indices((10, 10))[0], POINT, "45°"),
    ],
)
def test_what_cannot_rest_is_refused_in_a_sentence(heights, point, message):
    with pytest.raises(ContactInputError, match=message):
        resting(heights, 0.1, 1.0, point)
