"""Contact at rest: closed forms, an independent quadratic programme, and what tips over."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine, sphere
from gstlib.bem import ContactInputError, Layer, load_path, solve_contact
from gstlib.bem.closed_forms import RoundPunch
from gstlib.bem.rest import settle
from hypothesis import given, settings
from hypothesis import strategies as st


def places(shape, spacing):
    """(y, x) of the elements' centres, from the grid's corner; each of the grid's shape."""
    dy, dx = np.broadcast_to(spacing, 2)
    y, x = (np.arange(shape[0]) + 0.5) * dy, (np.arange(shape[1]) + 0.5) * dx
    return np.meshgrid(y, x, indexing="ij")


def plane(shape, spacing, slopes, point):
    y, x = places(shape, spacing)
    return slopes[0] * (y - point[0]) + slopes[1] * (x - point[1])


def centre_of(pressure, spacing):
    y, x = places(pressure.shape, spacing)
    return np.array([(pressure * y).sum(), (pressure * x).sum()]) / pressure.sum()


def resting(heights, spacing, force, load_point, **options):
    mean = force / (heights.size * np.prod(np.broadcast_to(spacing, 2)))
    options = {"tolerance": 1e-9} | options
    return solve_contact(
        heights, spacing, MODULUS, mean_pressure=mean, load_point=load_point, **options
    )


# --- closed forms


@pytest.mark.parametrize("elements", [(0, 5), (-7, 3)])
def test_a_paraboloid_rolls_under_a_force_off_its_summit(elements):
    n, spacing, radius, force = 90, 0.02, 15.0, 20.0
    heights, middle = sphere(n, spacing, radius), n * spacing / 2
    straight = resting(heights, spacing, force, (middle, middle))
    off = np.array(elements) * spacing
    rolled = resting(heights, spacing, force, middle + off)
    np.testing.assert_allclose(straight.tilt, 0, atol=1e-9)
    # The slope down to where the force is, e/R, is tilted up.
    np.testing.assert_allclose(rolled.tilt, off / radius, atol=1e-8)
    moved = np.roll(straight.pressure, elements, axis=(0, 1))
    np.testing.assert_allclose(rolled.pressure, moved, atol=1e-6 * moved.max())
    assert rolled.displacement == pytest.approx(straight.displacement, rel=1e-7)


def test_a_round_punch_tilts_as_johnson_says():
    # The radius is that of a disc of the elements' area. First order in the element.
    force, radius, off = 100.0, 1.0, 0.2
    errors = []
    for n in (32, 64, 128):
        spacing = 2 * radius / n
        y, x = places((n, n), spacing)
        disc = np.hypot(y - radius, x - radius) <= radius
        state = resting(np.where(disc, 0.0, -np.inf), spacing, force, (radius, radius + off))
        assert np.array_equal(state.contact, disc)
        assert np.all(np.isposinf(state.gap[~disc]))
        punch = RoundPunch(force, spacing * math.sqrt(disc.sum() / math.pi), MODULUS)
        errors.append(state.tilt[1] / punch.tilt(off) - 1)
        assert abs(state.tilt[0]) < 1e-6 * state.tilt[1]
    assert 0 < errors[-1] < 6e-3
    assert np.all(np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 1) < 0.15)


# --- planes


def test_gap_and_displacement_are_those_of_the_tilted_heights():
    spacing, point = 0.01, (0.31, 0.66)
    heights = self_affine(90, seed=7, length=0.9)
    state = resting(heights, spacing, 5.0, point)
    tilted = heights + plane(heights.shape, spacing, state.tilt, point)
    mean = {"mean_pressure": state.mean_pressure, "tolerance": 1e-9}
    fixed = solve_contact(tilted, spacing, MODULUS, **mean)
    assert fixed.displacement == pytest.approx(state.displacement, rel=1e-8)
    np.testing.assert_allclose(fixed.gap, state.gap, atol=1e-8 * state.displacement)
    away = np.hypot(*(centre_of(state.pressure, spacing) - point)) / 0.9
    assert away < 1e-9
    assert state.moment_residual <= 1e-9


# --- an independent solution


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 24), st.integers(1, 24), st.floats(1e-7, 1.0))
def test_any_surface_comes_to_rest_under_a_force_within_it(seed, ny, nx, mean_pressure):
    rng = np.random.default_rng(seed)
    heights, spacing = 1e-4 * rng.standard_normal((ny, nx)), rng.uniform(0.01, 0.1, 2)
    heights[rng.random((ny, nx)) < rng.uniform(0, 0.9)] = -np.inf
    heights[rng.integers(ny), rng.integers(nx)] = 0.0
    heights += plane((ny, nx), spacing, rng.uniform(-0.2, 0.2, 2), (0, 0))
    surface = np.isfinite(heights)
    weights = np.where(surface, rng.exponential(size=(ny, nx)) ** 4, 0)
    point = centre_of(weights, spacing)
    state = solve_contact(
        heights, spacing, MODULUS, mean_pressure=mean_pressure, load_point=point, tolerance=1e-8
    )
    assert max(state.residual, state.moment_residual) <= 1e-8
    assert state.iterations <= 40
    assert state.pressure.min() == 0 or surface.all()
    assert not state.pressure[~surface].any()
    distance = np.hypot(*(centre_of(state.pressure, spacing) - point))
    assert distance <= 1.1e-8 * max(ny * spacing[0], nx * spacing[1])


# --- few contacts, borders and starts


@pytest.mark.parametrize("load_point", [(0.012, 1.0), (1.9, 1.92), (1.0, 1.0)])
def test_a_force_near_the_border_of_a_large_grid(load_point):
    """Coarser grids end before it, and start from the nearest point that they have."""
    heights = self_affine(200, seed=8, length=2.0)
    state = resting(heights, 0.01, 5.0, load_point, tolerance=1e-7)
    assert max(state.residual, state.moment_residual) <= 1e-7
    assert state.convolutions <= 30


@pytest.mark.parametrize("count", [830, 1500])
@pytest.mark.parametrize("form", ["square", "disc"])
def test_a_point_is_inside_on_grids_of_any_size(count, form):
    """Its middle and places all over it are, its border too; 1e-5 elements beyond is not."""
    middle = (count - 1) / 2
    y, x = np.indices((count, count)) - middle
    flat = np.where((y**2 + x**2 > middle**2) & (form == "disc"), -np.inf, 0.0)
    radius, angle = np.random.default_rng(count).uniform(0, [[middle - 1], [7]], (2, 30))
    inside = [middle + radius * np.sin(angle), middle + radius * np.cos(angle)]
    inside = [(middle, middle), *zip(*inside, strict=True)]
    if form == "square":
        inside += [(middle, 0), (count - 1, middle), (count - 1, 0.3 * count)]
    for point in inside:
        place, _, supports = settle(flat, np.array(point))
        np.testing.assert_allclose(place, point, atol=1e-9)
        assert not flat.flat[supports].any()
    for beyond in [(-1e-5, middle), (middle, count - 1 + 1e-5)]:
        assert settle(flat, np.array(beyond)) is None


def test_a_neighbours_pressure_saves_most_of_the_work():
    heights = self_affine(256, seed=9, length=2.56) + sphere(256, 0.01, 100.0)
    start = resting(heights, 0.01, 10.0, (1.2, 1.3), tolerance=1e-6).pressure
    cold = resting(heights, 0.01, 10.0, (1.22, 1.3), tolerance=1e-6)
    warm = resting(heights, 0.01, 10.0, (1.22, 1.3), initial_pressure=start, tolerance=1e-6)
    np.testing.assert_allclose(warm.pressure, cold.pressure, atol=1e-4 * cold.pressure.max())
    np.testing.assert_allclose(warm.tilt, cold.tilt, atol=1e-8)
    assert warm.iterations <= cold.iterations
    again = resting(
        heights, 0.01, 10.0, (1.22, 1.3), initial_pressure=warm.pressure, tolerance=1e-5
    )
    assert again.iterations == 0
    # A start that cannot carry the force there is no start.
    elsewhere = np.zeros(heights.shape)
    elsewhere[:9, :9] = 1.0
    lost = resting(heights, 0.01, 10.0, (1.22, 1.3), initial_pressure=elsewhere, tolerance=1e-6)
    assert lost.iterations == cold.iterations


def test_a_layer_at_rest():
    heights, layer = self_affine(60, seed=3, length=0.6), Layer(100.0, 0.4, 0.05)
    state = resting(heights, 0.01, 1.0, (0.25, 0.34), layer=layer, tolerance=1e-7)
    tilted = heights + plane(heights.shape, 0.01, state.tilt, (0.25, 0.34))
    mean = {"mean_pressure": state.mean_pressure, "tolerance": 1e-7}
    fixed = solve_contact(tilted, 0.01, MODULUS, layer=layer, **mean)
    np.testing.assert_allclose(state.pressure, fixed.pressure, atol=1e-4 * fixed.pressure.max())


# --- no surface


def test_where_there_is_no_surface_nothing_touches():
    """As if it lay far below; in coarser grids and load paths too."""
    heights = self_affine(150, seed=2, length=1.5)
    y, x = places(heights.shape, 0.01)
    gone = np.hypot(y - 0.7, x - 0.8) > 0.6
    holed, deep = np.where(gone, -np.inf, heights), np.where(gone, -10.0, heights)
    for load in ({"displacement": 0.002}, {"mean_pressure": 20.0}):
        found, expected = (
            solve_contact(given, 0.01, MODULUS, tolerance=1e-9, **load) for given in (holed, deep)
        )
        peak = expected.pressure.max()
        np.testing.assert_allclose(found.pressure, expected.pressure, atol=1e-6 * peak)
        np.testing.assert_allclose(found.gap[~gone], expected.gap[~gone], atol=1e-11)
        assert np.all(np.isposinf(found.gap[gone]))
    path = load_path(holed, 0.01, MODULUS, target_pressure=20.0, steps=3)
    assert np.all(np.isfinite(path.stiffness))
    start = np.ones(heights.shape)
    warm = solve_contact(holed, 0.01, MODULUS, mean_pressure=20.0, initial_pressure=start)
    assert not warm.pressure[gone].any()


def test_no_force_leaves_the_rigid_rest():
    heights = np.full((9, 9), -1.0)
    tops = {(1, 1): 0.0, (7, 1): 0.03, (1, 7): 0.06}
    for place, top in tops.items():
        heights[place] = top
    state = resting(heights, 0.1, 0.0, (0.35, 0.35))
    np.testing.assert_allclose(state.tilt, (-0.05, -0.1), atol=1e-12)
    np.testing.assert_allclose([state.gap[place] for place in tops], 0, atol=1e-15)
    assert not state.contact.any()


# --- bad input

RIM = np.zeros((10, 10))
RIM[:, 6:] = -np.inf


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"load_point": (0.5, 0.7)}, r"tips over: .*\(0.5, 0.7\) mm lies outside .* Move it"),
        ({"load_point": (0.5, np.nan)}, r"load_point must be a point \(y, x\)"),
        ({"load_point": ("a", "b")}, r"load_point must be a point \(y, x\)"),
        ({"mean_pressure": None, "displacement": 1e-3}, "needs mean_pressure"),
        ({"pressure_cap": 100.0}, "no pressure_cap"),
        ({"heights": np.full((3, 3), -np.inf)}, "no surface"),
        ({"heights": np.where(np.eye(10) > 0, np.inf, 0)}, "10 values that are NaN or infinite"),
        ({"heights": np.diag([5.0] + [0.0] * 9)}, "tilt it by more than 45°"),
    ],
)
def test_what_cannot_rest_is_refused_in_a_sentence(change, message):
    arguments = {"heights": RIM, "mean_pressure": 1.0, "load_point": (0.5, 0.3)} | change
    heights = arguments.pop("heights")
    with pytest.raises(ContactInputError, match=message):
        solve_contact(heights, 0.1, MODULUS, **arguments)
