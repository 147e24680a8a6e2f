"""Closed forms have published values, and the force that they are given."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from gstlib.bem import measure_roughness
from gstlib.bem.closed_forms import (
    Cone,
    Ellipsoid,
    GreenwoodWilliamson,
    RoundPunch,
    love_rectangle_displacement,
    persson_contact_fraction,
    persson_pressure_density,
)
from gstlib.specimen.randomness import self_affine_field

ELLIPSOID = Ellipsoid(20.0, 12.0, 4.0, 1e4)
CONE = Cone(20.0, 1.4, 1e4)
PUNCH = RoundPunch(20.0, 0.3, 1e4)


@pytest.mark.parametrize(
    ("body", "a", "b"),
    [
        (ELLIPSOID, *ELLIPSOID.semi_axes),
        (CONE, CONE.contact_radius, CONE.contact_radius),
        (PUNCH, PUNCH.radius, PUNCH.radius),
    ],
)
def test_pressures_sum_to_the_force_and_end_at_the_edge(body, a, b):
    def ring(t):
        # r = a sin t takes the infinite pressure from the edge of a punch and the tip of a cone
        return body.pressure(a * math.sin(t), 0.0) * math.sin(t) * math.cos(t)

    integral, _ = quad(ring, 0, math.pi / 2)
    assert 2 * math.pi * a * b * integral == pytest.approx(body.force, rel=1e-6)
    assert body.pressure(1.001 * a, 0.0) == body.pressure(0.0, 1.001 * b) == 0
    assert body.pressure(0.0, 0.999 * b) > 0


def test_a_tilted_punch_is_about_to_lift_off_when_the_force_acts_at_a_third_of_its_radius():
    """Johnson, sect. 5.8: the moment's pressure is 3Md/2πa³ over the root, the force's 1/2πa."""
    least = PUNCH.tilt(PUNCH.radius / 3) * PUNCH.radius
    assert least == pytest.approx(PUNCH.displacement / 2)


@pytest.mark.parametrize("mean", [5.0, 80.0])
def test_perssons_pressures_carry_the_load_on_his_contact(mean):
    surface = mean, 0.02, 1e4
    touching, _ = quad(persson_pressure_density, 0, 2000, args=surface, limit=200)
    assert touching == pytest.approx(persson_contact_fraction(*surface))
    borne, _ = quad(
        lambda p: p * persson_pressure_density(p, *surface), 0, 2000, limit=200
    )
    assert borne == pytest.approx(mean)


def test_summits_of_greenwood_and_williamson_are_hertzs_spheres():
    rough, separation = GreenwoodWilliamson(50.0, 0.2, 2e-3, 1e4), 3e-3
    heights = np.linspace(separation, 0.02, 20001)
    depth = heights - separation
    weights = 50 * norm.pdf(heights, scale=2e-3)
    force = np.trapezoid(weights * 4 / 3 * 1e4 * np.sqrt(0.2 * depth**3), heights)
    area = np.trapezoid(weights * math.pi * 0.2 * depth, heights)
    assert rough.mean_pressure(separation) == pytest.approx(force, rel=1e-5)
    assert rough.contact_fraction(separation) == pytest.approx(area, rel=1e-5)


def test_greenwood_and_williamsons_summits_are_those_of_a_gaussian_surface():
    """Counted: elements above their eight neighbours."""
    waves = {"hurst_exponent": 0.8, "roll_off": 0.1, "shortest": 16 / 512}
    h = 1e-3 * self_affine_field(np.random.default_rng(2), 512, 1 / 512, **waves)
    shifts = [shift for shift in np.ndindex(3, 3) if shift != (1, 1)]
    around = [np.roll(h, np.subtract(shift, 1), (0, 1)) for shift in shifts]
    is_summit = h > np.max(around, axis=0)
    rough = measure_roughness(h, 1 / 512, periodic=True)
    summits = GreenwoodWilliamson.from_roughness(rough, 1.0)
    assert summits.density == pytest.approx(is_summit.sum(), rel=0.1)
    assert summits.height == pytest.approx(h[is_summit].std(), rel=0.1)
    curvature = (4 * h - around[1] - around[3] - around[4] - around[6]) * 512**2 / 2
    assert 1 / summits.radius == pytest.approx(curvature[is_summit].mean(), rel=0.1)


def test_a_loaded_rectangle_sinks_in_its_middle_and_is_a_point_from_afar():
    """Johnson, sect. 3.4: a square of half side a sinks by (8/π) ln(1 + √2) pa/E* in its middle."""
    middle = love_rectangle_displacement(0.0, 0.0, (2.0, 2.0), 3.0, 1e4)
    assert middle == pytest.approx(8 / math.pi * math.log(1 + math.sqrt(2)) * 3.0 / 1e4)
    far = love_rectangle_displacement(30.0, 40.0, (0.4, 0.2), 3.0, 1e4)
    assert far == pytest.approx(3.0 * 0.08 / (math.pi * 1e4 * 50.0), rel=1e-4)
