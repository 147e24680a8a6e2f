"""Surfaces that repeat themselves: closed forms, and a periodic operator written out afresh."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine
from gstlib.bem import ContactInputError, Layer, load_path, solve_contact, wear_path
from gstlib.bem.closed_forms import (
    Wave,
    crossed_waves_full_contact_pressure,
    crossed_waves_heavy_contact,
    crossed_waves_light_contact,
)

N, SIDE = 64, 0.3
ROUGH = self_affine(N, seed=5, length=SIDE, roll_off=0.1), SIDE / N, MODULUS


def wave_numbers(shape, spacing):
    """|q| (1/mm) of each wave of a field, shape (ny, nx)."""
    dy, dx = np.broadcast_to(spacing, 2)
    ny, nx = shape
    return 2 * np.pi * np.hypot(np.fft.fftfreq(ny, dy)[:, None], np.fft.fftfreq(nx, dx))


def displaced(pressure, spacing):
    """Displacement (mm), of mean zero, under 2/(E*|q|) per wave."""
    wave_number = wave_numbers(pressure.shape, spacing)
    wave_number[0, 0] = math.inf
    return np.fft.ifft2(np.fft.fft2(pressure) * 2 / (MODULUS * wave_number)).real


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8])
def test_westergaards_wave(share):
    """The displacement converges with the square of the element, the pressure as its edge lets."""
    wave = Wave(1e-3, 1.0, MODULUS)
    mean = share * wave.full_contact_pressure
    errors = []
    for n in (256, 4096):
        x = (np.arange(n) - n // 2) / n
        height = wave.amplitude * np.cos(2 * np.pi * x)[None]
        state = solve_contact(
            height, 1 / n, MODULUS, mean_pressure=mean, periodic=True, tolerance=1e-10
        )
        off = (state.pressure[0] - wave.pressure(x, mean)) / wave.full_contact_pressure
        errors.append((state.displacement / wave.displacement(mean) - 1, np.sqrt((off**2).mean())))
        assert state.contact_fraction == pytest.approx(wave.contact_fraction(mean), abs=3 / n)
    errors = np.abs(errors)
    assert errors[-1] == pytest.approx([0, 0], abs=1e-4)
    assert errors[-1, 0] < 1e-6
    assert np.log2(errors[0, 0] / errors[-1, 0]) / 4 > 1.8


# Solved on 256² elements by an independent periodic code, crests at elements' centres.
@pytest.mark.parametrize(("share", "expected"), [(0.01, 0.0361), (0.2, 0.3446), (0.9, 0.9505)])
def test_crossed_waves_touch_as_johnson_greenwood_and_higginson_say(share, expected):
    assert crossed_contact(share, 256) == pytest.approx(expected, abs=6e-5)


def test_crossed_waves_approach_both_asymptotes():
    assert crossed_contact(3e-4, 512) == pytest.approx(crossed_waves_light_contact(3e-4), rel=0.01)
    assert crossed_contact(0.995, 512) == pytest.approx(
        crossed_waves_heavy_contact(0.995), abs=1e-4
    )


def crossed_contact(share, n):
    """Contact fraction of n × n elements at a share of the load that closes crossed waves."""
    wavelength, amplitude = 0.1, 5e-4
    star = crossed_waves_full_contact_pressure(amplitude, wavelength, MODULUS)
    along = np.cos(2 * np.pi * np.arange(n) / n)
    surface = amplitude * np.outer(along, along), wavelength / n, MODULUS
    state = solve_contact(*surface, mean_pressure=share * star, periodic=True)
    return state.corrected_fraction


@pytest.mark.parametrize("layer", [None, Layer(50.0, 0.4, 0.02)])
def test_full_contact_is_linear(layer):
    """Each wave of the surface takes the pressure that its stiffness gives it, and no other."""
    shape, spacing = (45, 32), (0.01, 0.013)
    height = 1e-5 * np.random.default_rng(1).standard_normal(shape)
    state = solve_contact(
        height, spacing, MODULUS, mean_pressure=60.0, layer=layer, periodic=True, tolerance=1e-9
    )
    assert state.contact_fraction == 1
    wave_number = wave_numbers(shape, spacing).reshape(-1)[1:]
    compliance = 2 / (MODULUS * wave_number) + (1 / layer.stiffness(wave_number) if layer else 0)
    waves = np.fft.fft2(height).reshape(-1)[1:] / compliance
    expected = np.fft.ifft2(np.append(60.0 * height.size, waves).reshape(shape)).real
    np.testing.assert_allclose(state.pressure, expected, rtol=1e-6)
    # The layer gives way as a whole, too: by its oedometric compliance.
    alone = height.max() - height.mean()
    soft = 60.0 * 0.02 * 1.4 * 0.2 / (50.0 * 0.6) if layer else 0.0
    assert state.displacement == pytest.approx(alone + soft, rel=1e-6)


@pytest.mark.parametrize("shape", [(1, 15), (9, 12), (70, 65)])
@pytest.mark.parametrize("load", [{"mean_pressure": 30.0}, {"displacement": 8e-4}])
def test_contact_conditions_hold_on_any_grid(shape, load):
    spacing = 0.01, 0.013
    height = 1e-3 * np.random.default_rng(2).standard_normal(shape)
    state = solve_contact(height, spacing, MODULUS, periodic=True, tolerance=1e-9, **load)
    gap = displaced(state.pressure, spacing) + height.max() - height - state.displacement
    np.testing.assert_allclose(state.gap, gap, atol=1e-15)
    assert gap.min() >= -1e-9 * state.displacement
    assert np.abs(gap[state.contact]).max() <= 1e-9 * state.displacement
    for name, value in load.items():
        assert getattr(state, name) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("mean_pressure", [1e-3, 1e-12])
@pytest.mark.parametrize("shape", [(1, 64), (64, 64)])
def test_two_summits_share_a_small_load(shape, mean_pressure):
    """The higher one bears what brings it down to the other, and half of the rest."""
    one = np.zeros(shape)
    one[0, 0] = 1.0
    sunk = displaced(one, 0.01)
    far = np.unravel_index(sunk.argmin(), shape)
    apart, force = sunk[0, 0] - sunk[far], mean_pressure * one.size
    height = np.full(shape, -2 * apart * force)
    height[0, 0], height[far] = 0.0, -0.7 * apart * force
    options = {"mean_pressure": mean_pressure, "periodic": True, "tolerance": 1e-9}
    state = solve_contact(height, 0.01, MODULUS, **options)
    bearing = state.pressure[0, 0] / force, state.pressure[far] / force
    assert bearing == pytest.approx((0.85, 0.15), rel=1e-6)


def test_a_path_has_the_stiffness_of_its_own_slope_until_it_is_full():
    path = load_path(*ROUGH, target_pressure=300.0, steps=5, periodic=True, tolerance=1e-9)
    step = 1e-4 * path.displacement[2]
    around = [
        solve_contact(*ROUGH, displacement=at, periodic=True, tolerance=1e-11).mean_pressure
        for at in (path.displacement[2] - step, path.displacement[2] + step)
    ]
    assert path.stiffness[2] == pytest.approx(np.diff(around)[0] / (2 * step), rel=1e-4)
    height, *elastic = ROUGH
    full = load_path(height / 100, *elastic, target_pressure=300.0, steps=3, periodic=True)
    assert full.contact_fraction[-1] == 1
    assert np.isinf(full.stiffness).tolist() == [False, False, True]
    assert full.displacement[-1] == pytest.approx((height.max() - height.mean()) / 100)


def test_what_wears_is_in_contact_in_the_end():
    height, *elastic = ROUGH
    options = {"mean_pressure": 100.0, "periodic": True, "tolerance": 1e-9}
    path = wear_path(*ROUGH, mean_loss=2e-4, steps=4, **options)
    assert path.depth.mean() == pytest.approx(2e-4)
    direct = solve_contact(height - path.depth, *elastic, **options)
    np.testing.assert_allclose(
        path.final.pressure, direct.pressure, atol=1e-5 * direct.pressure.max()
    )


def test_a_cap_holds_and_a_flat_surface_carries_all_alike():
    capped = solve_contact(*ROUGH, mean_pressure=300.0, pressure_cap=900.0, periodic=True)
    assert capped.pressure.max() == 900
    assert capped.pressure.mean() == pytest.approx(300.0)
    flat = solve_contact(np.ones((6, 5)), 0.1, MODULUS, mean_pressure=7.0, periodic=True)
    assert np.all(flat.pressure == 7)
    assert (flat.displacement, flat.periodic) == (0, True)
    worn = wear_path(np.ones((6, 5)), 0.1, MODULUS, mean_pressure=7.0, mean_loss=0, periodic=True)
    assert worn.depth.max() == worn.final.residual == 0


@pytest.mark.parametrize(
    "load",
    [
        {"mean_pressure": 9.0, "load_point": (0.1, 0.1)},
        {"displacement": 1.001 * (ROUGH[0].max() - ROUGH[0].mean())},  # beyond full contact
    ],
)
def test_what_a_periodic_surface_cannot_do_is_refused(load):
    with pytest.raises(ContactInputError, match="periodic"):
        solve_contact(*ROUGH, periodic=True, **load)
