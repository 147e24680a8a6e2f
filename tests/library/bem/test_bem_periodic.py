"""Surfaces that repeat themselves: closed forms, and a periodic operator written out afresh."""

import math

import numpy as np
import pytest
from bem_reference import MODULUS, self_affine

from gstlib.bem import ContactInputError, Layer, load_path, solve_contact, wear_path

SPACING = 0.3 / 64
HEIGHTS = self_affine(64, seed=5, length=0.3, roll_off=0.1)
ROUGH = HEIGHTS, SPACING, MODULUS
MEAN_DEPTH = HEIGHTS.max() - HEIGHTS.mean()


@pytest.mark.parametrize("share", [0.05, 0.8])
def test_westergaards_wave(share):
    """Johnson, sect. 13.2. The displacement converges with the square of the element."""
    full, errors = math.pi * MODULUS * 1e-3, []
    displacement = 1e-3 * share * (1 - math.log(share))
    for n in (256, 4096):
        x = np.pi * (np.arange(n) - n // 2) / n
        options = {"mean_pressure": share * full, "periodic": True, "tolerance": 1e-10}
        state = solve_contact(1e-3 * np.cos(2 * x)[None], 1 / n, MODULUS, **options)
        inside = np.maximum(share - np.sin(x) ** 2, 0)
        off = state.pressure[0] / full - 2 * np.cos(x) * np.sqrt(inside)
        errors.append(abs(state.displacement / displacement - 1))
    assert math.log2(errors[0] / errors[1]) / 4 > 1.8
    assert np.sqrt((off**2).mean()) < 1e-4


# Solved on 256² elements by an independent periodic code, with crests at elements' centres.
@pytest.mark.parametrize(("share", "expected"), [(0.01, 0.0361), (0.9, 0.9505)])
def test_crossed_waves_touch_as_by_another_code(share, expected):
    """Their mean pressure is a share of √2 πE*Δ/λ, which closes them."""
    along = np.cos(2 * np.pi * np.arange(256) / 256)
    heights = 5e-4 * np.outer(along, along)
    mean_pressure = share * math.sqrt(2) * math.pi * MODULUS * 5e-4 / 0.1
    options = {"mean_pressure": mean_pressure, "periodic": True}
    state = solve_contact(heights, 0.1 / 256, MODULUS, **options)
    assert state.corrected_fraction == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize("layer", [None, Layer(50.0, 0.4, 0.02)])
def test_full_contact_is_linear(layer):
    """Each wave of the surface takes the pressure that its stiffness gives it, and no other."""
    spacing = (0.01, 0.013)
    height = 1e-5 * np.random.default_rng(1).standard_normal((45, 32))
    options = {"mean_pressure": 60.0, "periodic": True, "tolerance": 1e-9}
    state = solve_contact(height, spacing, MODULUS, layer=layer, **options)
    assert state.contact_fraction == 1
    along_y, along_x = map(np.fft.fftfreq, height.shape, spacing)
    wave_number = 2 * np.pi * np.hypot(along_y[:, None], along_x)
    wave_number[0, 0] = 1.0  # the mean is set below
    compliance = 2 / (MODULUS * wave_number)
    if layer:
        compliance += 1 / layer.stiffness(wave_number)
    waves = np.fft.fft2(height) / compliance
    waves[0, 0] = 60.0 * height.size
    np.testing.assert_allclose(state.pressure, np.fft.ifft2(waves).real, rtol=1e-6)
    # The layer gives way as a whole, too: by its oedometric compliance.
    soft = 60.0 * 0.02 * 1.4 * 0.2 / (50.0 * 0.6) if layer else 0.0
    depth = height.max() - height.mean()
    assert state.displacement == pytest.approx(depth + soft, rel=1e-6)


def test_the_stiffness_is_infinite_in_full_contact():
    options = {"target_pressure": 300.0, "steps": 3, "periodic": True}
    full = load_path(HEIGHTS / 100, SPACING, MODULUS, **options)
    assert np.isinf(full.stiffness).tolist() == [False, False, True]
    assert full.displacement[-1] == pytest.approx(MEAN_DEPTH / 100)


def test_a_flat_surface_carries_all_alike_and_sinks_nowhere():
    load = {"mean_pressure": 7.0, "mean_loss": 0, "periodic": True}
    worn = wear_path(np.ones((6, 5)), 0.1, MODULUS, **load)
    assert np.all(worn.final.pressure == 7)
    assert worn.final.displacement == worn.depth.max() == worn.final.residual == 0


@pytest.mark.parametrize(
    "load",
    [
        {"mean_pressure": 9.0, "load_point": (0.1, 0.1)},
        {"displacement": 1.001 * MEAN_DEPTH},  # beyond full contact
    ],
)
def test_what_a_periodic_surface_cannot_do_is_refused(load):
    with pytest.raises(ContactInputError, match="periodic"):
        solve_contact(*ROUGH, periodic=True, **load)
