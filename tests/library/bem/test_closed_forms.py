"""Closed forms have published values, and the force that they are given."""

import math

import numpy as np
import pytest
from gstlib.bem import measure_roughness
from gstlib.bem.closed_forms import (
    Cone,
    Ellipsoid,
    GreenwoodWilliamson,
    RoundPunch,
    Sphere,
    love_rectangle_displacement,
    persson_contact_fraction,
    persson_pressure_density,
)
from gstlib.specimen.randomness import self_affine_field
from scipy.integrate import quad
from scipy.stats import norm

SPHERE = Sphere(20.0, 10.0, 1e4)
ELLIPSOID = Ellipsoid(20.0, 12.0, 4.0, 1e4)
CONE = Cone(20.0, 1.4, 1e4)
PUNCH = RoundPunch(20.0, 0.3, 1e4)


@pytest.mark.parametrize(
    ("body", "axes"),
    [
        (SPHERE, 2 * (SPHERE.contact_radius,)),
        (ELLIPSOID, ELLIPSOID.semi_axes),
        (CONE, 2 * (CONE.contact_radius,)),
        (PUNCH, 2 * (PUNCH.radius,)),
    ],
)
def test_pressures_sum_to_the_force_and_end_at_the_edge(body, axes):
    a, b = axes
    # r = a sin t takes the infinite pressure from the edge of a punch and the tip of a cone
    along = quad(
        lambda t: body.pressure(a * math.sin(t), 0.0) * math.sin(t) * math.cos(t), 0, math.pi / 2
    )[0]
    assert 2 * math.pi * a * b * along == pytest.approx(body.force, rel=1e-6)
    assert body.pressure(1.001 * a, 0.0) == body.pressure(0.0, 1.001 * b) == 0
    assert body.pressure(0.999 * a, 0.0) > 0
    assert body.pressure(0.0, 0.999 * b) > 0


def test_a_tilted_punch_is_about_to_lift_off_when_the_force_acts_at_a_third_of_its_radius():
    """Johnson, sect. 5.8: the moment's pressure is 3Md/2πa³ over the root, the force's 1/2πa."""
    least = PUNCH.tilt(PUNCH.radius / 3) * PUNCH.radius
    assert least == pytest.approx(PUNCH.displacement / 2)


@pytest.mark.parametrize("mean", [5.0, 80.0])
def test_perssons_pressures_carry_the_load_on_his_contact(mean):
    given = mean, 0.02, 1e4
    touching = quad(persson_pressure_density, 0, 2000, args=given, limit=200)[0]
    carried = quad(lambda p: p * persson_pressure_density(p, *given), 0, 2000, limit=200)[0]
    assert touching == pytest.approx(persson_contact_fraction(*given))
    assert carried == pytest.approx(mean)


@pytest.mark.parametrize("separation", [-1e-3, 0.0, 3e-3])
def test_summits_of_greenwood_and_williamson_are_hertzs_spheres(separation):
    rough = GreenwoodWilliamson(50.0, 0.2, 2e-3, 1e4)

    def borne(height):
        depth = height - separation
        sphere = Sphere(4 / 3 * 1e4 * math.sqrt(0.2 * depth**3), 0.2, 1e4)
        assert sphere.displacement == pytest.approx(depth)
        share = 50 * norm.pdf(height, scale=2e-3)
        return share * sphere.force, share * math.pi * sphere.contact_radius**2

    force, area = (
        quad(lambda s, of=of: borne(s)[of], separation + 1e-12, 0.02, epsabs=0)[0] for of in (0, 1)
    )
    assert rough.mean_pressure(separation) == pytest.approx(force, rel=1e-6)
    assert rough.contact_fraction(separation) == pytest.approx(area, rel=1e-6)


def test_greenwood_and_williamsons_summits_are_those_of_a_gaussian_surface():
    """Counted: elements above their eight neighbours."""
    waves = {"hurst_exponent": 0.8, "roll_off": 0.1, "shortest": 16 / 512}
    h = 1e-3 * self_affine_field(np.random.default_rng(2), 512, 1 / 512, **waves)
    around = [np.roll(h, by, (0, 1)) for by in np.ndindex(3, 3) if by != (1, 1)]
    around = [np.roll(of, (-1, -1), (0, 1)) for of in around]
    summits = h > np.max(around, axis=0)
    laplacian = sum(np.roll(h, by, axis) - h for by in (1, -1) for axis in (0, 1)) * 512**2
    said = GreenwoodWilliamson.of(measure_roughness(h, 1 / 512, periodic=True), 1.0)
    assert said.density == pytest.approx(summits.sum(), rel=0.1)
    assert said.height == pytest.approx(h[summits].std(), rel=0.1)
    assert 1 / said.radius == pytest.approx(-laplacian[summits].mean() / 2, rel=0.1)


def test_a_loaded_rectangle_sinks_in_its_middle_and_is_a_point_from_afar():
    """Johnson, sect. 3.4: a square of half side a sinks by (8/π) ln(1 + √2) pa/E* in its middle."""
    middle = love_rectangle_displacement(0.0, 0.0, (2.0, 2.0), 3.0, 1e4)
    assert middle == pytest.approx(8 / math.pi * math.log(1 + math.sqrt(2)) * 3.0 / 1e4)
    far = love_rectangle_displacement(30.0, 40.0, (0.4, 0.2), 3.0, 1e4)
    assert far == pytest.approx(3.0 * 0.08 / (math.pi * 1e4 * 50.0), rel=1e-4)
