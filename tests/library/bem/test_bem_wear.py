"""Wear by Archard's law: conservation, closed forms, and the order of its steps."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from numpy.testing import assert_allclose

from gstlib.bem import ContactInputError, Layer, ThirdBody, solve_contact, wear_path

SPACING = 0.85 / 80
HEIGHTS = self_affine(80, seed=2)
SURFACE = HEIGHTS, SPACING, MODULUS
WEAR = {"mean_pressure": 76.0, "mean_loss": 2e-4, "tolerance": 1e-9}
SOFT = Layer(20.0, 0.2, 0.3)


@pytest.mark.parametrize(("lost", "periodic"), [(0, False), (40, False), (0, True)])
def test_the_final_contact_is_that_of_the_worn_surface(lost, periodic):
    """Also where a corner has no surface."""
    diagonals = np.add.outer(np.arange(80), np.arange(80))
    heights = np.where(diagonals < lost, -math.inf, HEIGHTS)
    path = wear_path(heights, SPACING, MODULUS, **WEAR, steps=3, periodic=periodic)
    options = {"mean_pressure": 76.0, "periodic": periodic, "tolerance": 1e-10}
    direct = solve_contact(heights - path.depth, SPACING, MODULUS, **options)
    final, within = path.final, 1e-6 * direct.pressure.max()
    assert_allclose(final.pressure, direct.pressure, atol=within)
    assert_allclose(final.gap, direct.gap, atol=1e-8 * direct.displacement)
    assert final.displacement == pytest.approx(direct.displacement, rel=1e-8)


def test_stone_and_third_body_take_turns_by_their_coefficients_and_forces():
    """The third body has its share of κ; its pressure may differ from the bare stone's."""
    bare, soft = np.array([76.0, 60.0]), np.array([20.0, 25.0])
    body = ThirdBody(SOFT, 0.25, soft)
    options = {"mean_loss": 3e-4, "steps": 2, "keep_depths": True, "keep_states": True}
    path = wear_path(*SURFACE, mean_pressure=bare, third_body=body, **options)
    each = 0.75 * bare + 0.25 * soft
    assert_allclose(path.mean_loss, 3e-4 * each.cumsum() / each.sum(), rtol=1e-12)
    assert path.depth.mean() == pytest.approx(3e-4, rel=1e-12)
    # Each is pressed on what both have left; in a step, the stone wears first.
    stone, third = path.states[-1]
    by_stone = 0.75 * 3e-4 / each.sum() * stone.pressure
    for state, worn, layer, mean in (
        (stone, path.depths[0] + by_stone, None, 60.0),
        (third, path.depth, SOFT, 25.0),
    ):
        left = solve_contact(
            HEIGHTS - worn, SPACING, MODULUS, mean_pressure=mean, layer=layer
        )
        within = 1e-3 * left.pressure.max()
        assert_allclose(state.pressure, left.pressure, atol=within)


def test_loads_beyond_the_grid_may_lower_the_surface_for_the_third_body_alone():
    deep = np.where(np.indices((80, 80))[1] < 40, 1.0, 0.0)
    body = ThirdBody(SOFT, 1.0, 20.0, deep)
    load = {"mean_pressure": 0.0, "mean_loss": 1e-4, "steps": 1}
    depth = wear_path(*SURFACE, **load, third_body=body).depth
    assert depth[:, :40].max() == 0 < depth[:, 40:].min()


def test_a_cap_bounds_what_a_step_takes_off_and_leaves_the_volume():
    limit, steps = 1500.0, 4
    elastic = wear_path(*SURFACE, **WEAR, steps=steps)
    capped = wear_path(*SURFACE, **WEAR, steps=steps, pressure_cap=limit)
    assert_allclose(capped.mean_loss, elastic.mean_loss, rtol=1e-12)
    most = limit * 2e-4 / 76.0
    assert capped.depth.max() <= most * (1 + 1e-9) < elastic.depth.max()


HALF = np.where(np.indices((80, 80))[0] < 40, -np.inf, HEIGHTS)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mean_loss": 1.0}, "mean_loss"),
        ({"steps": 0}, "steps"),
        ({"mean_pressure": 0.0}, "mean_pressure"),
        ({"mean_pressure": [1.0, 2.0]}, "mean_pressure"),
        ({"pressure_cap": 76.0}, "not below pressure_cap"),
        ({"heights": HALF, "pressure_cap": 114.0}, "50 % of the grid"),
        ({"third_body": ThirdBody(SOFT, 0.5, 1.0, np.ones(80))}, "third_body.lowered"),
    ],
)
def test_bad_input_is_named(wrong, message):
    options = {"heights": HEIGHTS} | WEAR | wrong
    with pytest.raises(ContactInputError, match=message):
        wear_path(spacing=SPACING, contact_modulus=MODULUS, **options)
