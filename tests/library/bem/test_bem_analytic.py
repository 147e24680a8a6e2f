"""The solver against closed forms, with rates of convergence."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, centred, sphere

from gstlib.bem import load_path, solve_contact, wear_path
from gstlib.bem.closed_forms import Sphere


def test_a_sphere_converges_to_hertzs_pressure_and_displacement():
    exact = Sphere(20.0, 10.0, MODULUS)
    depth = exact.contact_radius**2 / exact.radius
    errors = []
    for n in (48, 192):
        spacing = 2.6 * exact.contact_radius / n
        heights = sphere(n, spacing, exact.radius)
        load = {"mean_pressure": exact.force / (n * spacing) ** 2, "tolerance": 1e-8}
        state = solve_contact(heights, spacing, MODULUS, **load)
        misfit = state.pressure - exact.pressure(*centred(n, spacing))
        touch = state.displacement - heights.max()
        errors.append((misfit.std() / exact.peak_pressure, abs(touch / depth - 1)))
    assert np.all(np.less(errors[1], (2e-3, 2e-4)))
    rates = np.log2(np.divide(*errors)) / 2
    assert np.all(rates > (0.9, 1.2))


def test_square_punch_extrapolates_to_the_constant():
    """1.1523 E* times the side and the displacement, from below."""
    errors = []
    for n in (32, 64, 128):
        path = load_path(np.zeros((n, n)), 1 / n, MODULUS, target_pressure=1.0, steps=1)
        errors.append(1.1523 - path.stiffness[0] / MODULUS)
    assert 2 * errors[2] - errors[1] == pytest.approx(0, abs=1e-4)
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx([2, 2], abs=0.07)


def test_a_round_punch_tilts_as_johnson_says():
    """By 3Pd/4E*a³, the force acting d from its axis (eq. 5.36)."""
    # The radius is that of a disc of the elements' area. First order in the element.
    force, radius, off = 100.0, 1.0, 0.2
    errors = []
    for n in (32, 64):
        spacing = 2 * radius / n
        disc = np.hypot(*centred(n, spacing)) <= radius
        load = {"mean_pressure": force / 4, "load_point": (radius, radius + off)}
        state = solve_contact(np.where(disc, 0.0, -np.inf), spacing, MODULUS, **load)
        assert np.array_equal(state.contact, disc)
        equal = spacing * math.sqrt(disc.sum() / math.pi)
        expected = 0.75 * force * off / (MODULUS * equal**3)
        errors.append(state.tilt[1] / expected - 1)
    assert 0 < errors[1] < 0.012
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.2)


def test_a_wave_in_full_contact_wears_flat_exponentially():
    """At the rate q E*/2 for each κ, as the pressure of a wave of amplitude a is a q E*/2."""
    size, spacing, amplitude, steps = 128, 0.85 / 80, 1e-4, 20
    phase = 2 * math.pi * 16 * (np.arange(size) + 0.5) / size
    wave = np.cos(phase)
    q = (phase[1] - phase[0]) / spacing
    half_life = math.log(2) / (q * MODULUS / 2)  # of the amplitude, in κ (mm/MPa)
    heights = amplitude * wave * np.ones((size, 1))
    load = {"mean_pressure": 110.0, "mean_loss": 110.0 * half_life}
    path = wear_path(heights, spacing, MODULUS, **load, steps=steps)
    assert path.final.contact_fraction == 1
    middle = slice(size // 4, 3 * size // 4)  # away from the edges of the half-space
    worn = path.depth[middle, middle].mean(axis=0)
    left = 1 - 2 * (worn * wave[middle]).mean() / amplitude
    # Backward Euler leaves 1/(1 + ln 2/steps) of the amplitude in each step.
    assert left == pytest.approx((1 + math.log(2) / steps) ** -steps, rel=0.02)
