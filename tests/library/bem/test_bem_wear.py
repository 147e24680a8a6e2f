"""Wear by Archard's law: conservation, closed forms, and the order of its steps."""

import itertools
import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from gstlib.bem import ContactInputError, Layer, ThirdBody, solve_contact, wear_path

SPACING = 0.85 / 80
SURFACE = self_affine(80, seed=2), SPACING, MODULUS
WEAR = {"mean_pressure": 76.0, "mean_loss": 2e-4}


@pytest.fixture(scope="module")
def path():
    return wear_path(*SURFACE, **WEAR, steps=10, tolerance=1e-9)


def test_what_is_lost_is_wear_coefficient_times_force_times_sliding():
    pressures = np.array([10.0, 0.0, 30.0, 20.0])
    path = wear_path(*SURFACE, mean_pressure=pressures, mean_loss=3e-4, steps=4)
    np.testing.assert_allclose(path.mean_loss, 3e-4 * pressures.cumsum() / 60, rtol=1e-12)
    np.testing.assert_allclose(path.mean_pressure, pressures, rtol=1e-12)
    assert path.depth.mean() == pytest.approx(3e-4, rel=1e-12)


@pytest.mark.parametrize("lost", [0, 40])
def test_the_final_contact_is_that_of_the_worn_surface(lost):
    """Also where a corner has no surface."""
    heights, *elastic = SURFACE
    diagonals = np.add.outer(np.arange(80), np.arange(80))
    heights = np.where(diagonals < lost, -math.inf, heights)
    path = wear_path(heights, *elastic, **WEAR, steps=3, tolerance=1e-9)
    direct = solve_contact(heights - path.depth, *elastic, mean_pressure=76.0, tolerance=1e-10)
    assert path.final.residual <= 2e-9
    np.testing.assert_allclose(
        path.final.pressure, direct.pressure, atol=1e-6 * direct.pressure.max()
    )
    np.testing.assert_allclose(path.final.gap, direct.gap, atol=1e-8 * direct.displacement)
    assert path.final.displacement == pytest.approx(direct.displacement, rel=1e-8)
    assert path.contact_fraction[-1] == pytest.approx(direct.contact_fraction, abs=2 / 80**2)


def test_a_step_is_a_contact_behind_springs():
    step = wear_path(*SURFACE, **WEAR, steps=1, tolerance=1e-9).final
    springs = WEAR["mean_loss"] / 76.0
    behind = solve_contact(*SURFACE, mean_pressure=76.0, springs=springs, tolerance=1e-9)
    np.testing.assert_allclose(behind.pressure, step.pressure, atol=1e-6 * step.pressure.max())


def test_nothing_wears_out_of_contact_and_nothing_grows(path):
    assert path.depth.min() == 0
    single = wear_path(*SURFACE, **WEAR, steps=1)
    np.testing.assert_array_equal(single.depth > 0, single.final.contact)
    np.testing.assert_allclose(single.depth * 76.0, 2e-4 * single.final.pressure, rtol=1e-12)
    assert np.all(np.diff(path.contact_fraction) > 0)


@pytest.mark.parametrize(
    ("body", "within"), [(None, 0.25), (ThirdBody(Layer(300.0, 0.3, 0.3), 0.5, 30.0), 0.3)]
)
def test_error_is_of_first_order_in_the_step(body, within):
    """Of the stone alone, and with the third body in turn."""
    depths = [
        wear_path(*SURFACE, **WEAR, steps=steps, tolerance=1e-8, third_body=body).depth
        for steps in (5, 10, 20, 40)
    ]
    changes = [np.linalg.norm(b - a) for a, b in itertools.pairwise(depths)]
    np.testing.assert_allclose(np.divide(changes[:-1], changes[1:]), 2, atol=within)


def test_a_wave_in_full_contact_wears_flat_exponentially():
    """At the rate q E*/2 for each κ, as the pressure of a wave of amplitude a is a q E*/2."""
    size, waves, amplitude, steps = 128, 16, 1e-4, 20
    q = 2 * math.pi * waves / (size * SPACING)
    wave = np.cos(2 * math.pi * waves * (np.arange(size) + 0.5) / size)
    half_life = math.log(2) / (q * MODULUS / 2)  # of the amplitude, in κ (mm/MPa)
    path = wear_path(
        amplitude * wave * np.ones((size, 1)),
        SPACING,
        MODULUS,
        mean_pressure=110.0,
        mean_loss=110.0 * half_life,
        steps=steps,
    )
    assert path.contact_fraction[-1] == 1
    middle = slice(size // 4, 3 * size // 4)  # away from the edges of the half-space
    worn = path.depth[middle, middle].mean(axis=0)
    left = 1 - 2 * (worn * wave[middle]).mean() / amplitude
    # Backward Euler leaves 1/(1 + ln 2/steps) of the amplitude in each step.
    assert left == pytest.approx((1 + math.log(2) / steps) ** -steps, rel=0.02)
    assert left == pytest.approx(0.5, rel=0.04)


SOFT = Layer(20.0, 0.2, 0.3)


def test_stone_and_third_body_take_what_their_coefficients_and_forces_say():
    """The third body has its share of κ; its pressure may differ from the bare stone's."""
    bare, soft = np.array([76.0, 50.0, 60.0]), np.array([20.0, 30.0, 25.0])
    body = ThirdBody(SOFT, 0.25, soft)
    options = {"mean_pressure": bare, "mean_loss": 3e-4, "steps": 3, "keep_depths": True}
    path = wear_path(*SURFACE, **options, third_body=body, keep_states=True)
    each = 0.75 * bare + 0.25 * soft
    np.testing.assert_allclose(path.mean_loss, 3e-4 * each.cumsum() / each.sum(), rtol=1e-12)
    for states, pressures in zip(path.states, zip(bare, soft, strict=True), strict=True):
        assert [state.mean_pressure for state in states] == pytest.approx(pressures, rel=1e-12)
    np.testing.assert_array_equal(path.depths[-1], path.depth)
    assert (path.depths[1] >= path.depths[0]).all()
    # Each is pressed on what both have left; in a step, the stone wears first.
    heights, *elastic = SURFACE
    stone, third = path.states[-1]
    of_stone = 0.75 * 3e-4 / each.sum() * stone.pressure
    for state, worn, layer in ((stone, path.depths[1] + of_stone, None), (third, path.depth, SOFT)):
        mean = {"mean_pressure": state.mean_pressure, "layer": layer}
        left = solve_contact(heights - worn, *elastic, **mean)
        np.testing.assert_allclose(state.pressure, left.pressure, atol=1e-3 * left.pressure.max())
    # The softer of the two reaches where the bare stone does not.
    assert path.states[-1][1].contact_fraction > 2 * path.states[-1][0].contact_fraction


def test_a_third_body_without_a_share_changes_nothing_and_alone_it_does_all(path):
    body = ThirdBody(SOFT, 0.0, 20.0)
    same = wear_path(*SURFACE, **WEAR, steps=10, tolerance=1e-9, third_body=body)
    np.testing.assert_array_equal(same.depth, path.depth)
    heights, *elastic = SURFACE
    one = {"mean_pressure": 0.0, "mean_loss": 1e-4, "steps": 1}
    alone = wear_path(*SURFACE, **one, third_body=ThirdBody(SOFT, 1.0, 20.0))
    worn = solve_contact(heights - alone.depth, *elastic, mean_pressure=20.0, layer=SOFT)
    np.testing.assert_allclose(alone.depth * 20, 1e-4 * worn.pressure, atol=1e-8)
    # Loads beyond the grid may lower the surface for the third body alone.
    deep = np.where(np.arange(80) < 40, 1.0, 0.0)
    tilted = wear_path(*SURFACE, **one, third_body=ThirdBody(SOFT, 1.0, 20.0, deep))
    assert tilted.depth[:, :40].max() == 0 < tilted.depth[:, 40:].min()


def test_a_cap_bounds_what_a_step_takes_off_and_leaves_the_volume(path):
    limit, steps = 1500.0, 4
    yielding = wear_path(*SURFACE, **WEAR, steps=steps, pressure_cap=limit, tolerance=1e-9)
    elastic = wear_path(*SURFACE, **WEAR, steps=steps, tolerance=1e-9)
    assert elastic.final.pressure.max() > limit
    np.testing.assert_allclose(yielding.mean_loss, elastic.mean_loss, rtol=1e-12)
    most = limit * WEAR["mean_loss"] / WEAR["mean_pressure"]
    assert yielding.depth.max() <= most * (1 + 1e-9)
    assert elastic.depth.max() > most
    # the last step is the contact with that cap of the surface that is left
    heights, spacing, modulus = SURFACE
    left = heights - yielding.depth
    options = {"mean_pressure": 76.0, "pressure_cap": limit, "tolerance": 1e-9}
    state = solve_contact(left, spacing, modulus, **options)
    np.testing.assert_allclose(yielding.final.pressure, state.pressure, atol=1e-5 * limit)
    far = wear_path(*SURFACE, **WEAR, steps=steps, pressure_cap=1e6, tolerance=1e-9)
    np.testing.assert_array_equal(far.depth, elastic.depth)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"mean_loss": 1.0}, "mean_loss"),
        ({"mean_pressure": 0.0}, "mean_pressure"),
        ({"mean_pressure": [1.0, 2.0]}, "mean_pressure"),
        ({"steps": 2.5}, "steps"),
        ({"third_body": ThirdBody(SOFT, 1.5, 1.0)}, "share"),
        ({"pressure_cap": 76.0}, "not below pressure_cap"),
    ],
)
def test_bad_input_is_named(wrong, said):
    with pytest.raises(ContactInputError, match=said):
        wear_path(*SURFACE, **{**WEAR, **wrong})
