"""Closed forms have published values, and the force that they are given."""

import math
from dataclasses import replace

import numpy as np
import pytest
from gstlib.bem import contact_modulus, measure_roughness
from gstlib.bem.closed_forms import (
    BUSH_SLOPE,
    PERSSON_SLOPE,
    Cone,
    Ellipsoid,
    GreenwoodWilliamson,
    RoundPunch,
    Sphere,
    Wave,
    crossed_waves_full_contact_pressure,
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
WAVE = Wave(1e-3, 0.5, 1e4)


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


@pytest.mark.parametrize(
    ("body", "power"), [(SPHERE, 1.5), (ELLIPSOID, 1.5), (CONE, 2), (PUNCH, 1)]
)
def test_the_force_is_a_power_of_the_displacement(body, power):
    harder = replace(body, force=3 * body.force)
    assert harder.displacement / body.displacement == pytest.approx(3 ** (1 / power))


def test_a_ball_of_steel_on_steel():
    """10 mm, 100 N: E* = 115,385 MPa, a³ = 0.00325 mm³, p₀ = 150/πa², δ = a²/5, by hand."""
    ball = Sphere(100.0, 5.0, contact_modulus(210e3, 0.3, 210e3, 0.3))
    assert ball.contact_radius == pytest.approx(0.1481, abs=1e-4)
    assert ball.peak_pressure == pytest.approx(2176, abs=1)
    assert ball.displacement == pytest.approx(4.39e-3, abs=1e-5)
    step = replace(ball, force=100.1).displacement - replace(ball, force=99.9).displacement
    assert ball.stiffness == pytest.approx(0.2 / step, rel=1e-6)


def test_half_axes_are_those_of_hertzs_table():
    """S. P. Timoshenko & J. N. Goodier, Theory of Elasticity, art. 140: m, n at cos θ = 1/2."""
    unit = (0.75 * 20.0 / (1e4 * (1 / 24 + 1 / 8))) ** (1 / 3)
    assert np.divide(ELLIPSOID.semi_axes, unit) == pytest.approx((1.486, 0.717), abs=1e-3)
    across = replace(ELLIPSOID, radius_x=4.0, radius_y=12.0)
    assert across.semi_axes == ELLIPSOID.semi_axes[::-1]
    nearly = Ellipsoid(20.0, 10.001, 9.999, 1e4)
    assert nearly.semi_axes == pytest.approx(2 * [SPHERE.contact_radius], rel=2e-4)
    assert nearly.displacement == pytest.approx(SPHERE.displacement, rel=2e-4)


def test_a_sphere_sticks_all_over_until_it_is_pushed_and_nowhere_when_it_slides():
    assert SPHERE.stick_radius(0.0) == SPHERE.contact_radius
    assert SPHERE.stick_radius(0.875) == pytest.approx(SPHERE.contact_radius / 2)
    assert SPHERE.stick_radius(1.0) == 0


def test_a_tilted_punch_is_about_to_lift_off_when_the_force_acts_at_a_third_of_its_radius():
    """Johnson, sect. 5.8: the moment's pressure is 3Md/2πa³ over the root, the force's 1/2πa."""
    least = PUNCH.tilt(PUNCH.radius / 3) * PUNCH.radius
    assert least == pytest.approx(PUNCH.displacement / 2)


@pytest.mark.parametrize("share", [0.01, 0.4, 1.0, 1.7])
def test_a_wave_bears_its_mean_pressure_over_its_contact(share):
    mean = share * WAVE.full_contact_pressure
    half = WAVE.contact_fraction(mean) * WAVE.wavelength / 2
    borne = quad(WAVE.pressure, -half, half, args=(mean,))[0]
    assert borne / WAVE.wavelength == pytest.approx(mean, rel=1e-6)
    # the crest sinks by the displacement, under a line load's −2/πE* ln 2 sin(πx/λ) and its images
    sunk = quad(lambda x: WAVE.pressure(x, mean) * math.log(2 * math.sin(2 * math.pi * x)), 0, half)
    assert WAVE.displacement(mean) == pytest.approx(-4 / (math.pi * 1e4) * sunk[0], rel=1e-6)
    # next to a crest too light to flatten it, Hertz's line contact: a² = 4PR/πE*
    if share < 0.1:
        radius = WAVE.wavelength**2 / (4 * math.pi**2 * WAVE.amplitude)
        line = math.sqrt(4 * mean * WAVE.wavelength * radius / (math.pi * 1e4))
        assert half == pytest.approx(line, rel=5e-3)


def test_waves_close_where_their_valleys_just_bear():
    star = WAVE.full_contact_pressure
    assert star == pytest.approx(62.83, abs=0.01)
    assert WAVE.pressure(WAVE.wavelength / 2, star) == pytest.approx(0, abs=1e-9)
    # crossed waves have √2 the wave number in each of two directions, at half the height
    assert crossed_waves_full_contact_pressure(1e-3, 0.5, 1e4) == pytest.approx(
        2 * Wave(0.5e-3, 0.5 / math.sqrt(2), 1e4).full_contact_pressure
    )


def test_perssons_contact_starts_with_his_slope_and_ends_full():
    assert persson_contact_fraction(1e-4, 1.0, 1.0) == pytest.approx(1e-4 * PERSSON_SLOPE)
    assert persson_contact_fraction(10.0, 1.0, 1.0) == pytest.approx(1)
    assert pytest.approx((1.596, 2.507), abs=1e-3) == (PERSSON_SLOPE, BUSH_SLOPE)


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
