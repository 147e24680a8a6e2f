"""Registration recovers known transformations, and reports when it cannot."""

from itertools import combinations

import numpy as np
import pytest
from stones import seen, waves

from gstlib.change.registration import apply_registration, register
from gstlib.surfaces.grid import make_surface

SPACING = 1.66e-3
SIZE = 128
FAR = 0.7 * SIZE * SPACING


def error_in_elements(registration, shift):
    stated = np.array([registration.shift_y_mm, registration.shift_x_mm]) / SPACING
    return np.hypot(*(stated - shift))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("turn_deg", [-1.0, 2.0])
def test_within_a_fifth_of_the_field_and_two_degrees_all_are_registered(
    remeasure, seed, turn_deg
):
    way = 2 * seed + turn_deg
    shift = 0.2 * SIZE * np.array([np.sin(way), np.cos(way)])
    t0, t1, _ = remeasure(seed, shift, turn_deg)
    registration = register(t0, t1, maximum_shift_mm=FAR)
    assert registration.is_reliable
    assert error_in_elements(registration, shift) < 0.2
    assert registration.rotation_deg == pytest.approx(turn_deg, abs=0.05)


def test_surfaces_that_have_nothing_in_common_are_not_believed(remeasure, monkeypatch):
    """Also not with a lower bound on the correlation, where the overlap is small."""
    monkeypatch.setattr("gstlib.change.search.LEAST_CORRELATION", 0.3)
    surfaces = [remeasure(100 + seed)[0] for seed in range(5)]
    beyond_reach = remeasure(1, (0.95 * SIZE, 0.0))[:2]
    flat = make_surface(np.zeros((40, 40)), SPACING)
    for pair in [*combinations(surfaces, 2), beyond_reach, (flat, flat)]:
        assert not register(*pair, maximum_shift_mm=FAR).is_reliable


def rough(seed, **options):
    return waves(seed, 0.012, 0.1, 3e-3, **options)


def scan(heights, spacing, shift=(0.0, 0.0), turn_deg=0.0, shape=(96, 112)):
    rng = np.random.default_rng(len(str(shift)))
    noise = 1e-5 * rng.standard_normal(shape)
    return make_surface(seen(heights, spacing, shift, turn_deg, shape) + noise, spacing)


def striated(relief, lean_deg=0.0):
    """Striae that lean so much, on a stone with so much of the relief of others."""
    striae, stone = rough(2, across_only=True), rough(3)
    lean = np.radians(lean_deg)

    def heights(y, x):
        across = np.cos(lean) * x + np.sin(lean) * y
        return striae(y, across) + relief * stone(y, x)

    return heights


def test_a_turn_is_one_in_mm_on_points_that_are_not_square():
    spacing, stone = (2e-3, 1e-3), rough(1)
    t0, t1 = scan(stone, spacing), scan(stone, spacing, (0.01, -0.006), 1.5)
    registration = register(t0, t1, maximum_shift_mm=0.05)
    assert registration.is_reliable
    assert registration.rotation_deg == pytest.approx(1.5, abs=0.02)
    assert registration.shift_y_mm == pytest.approx(0.01, abs=5e-5)
    assert registration.residual_mm < 3e-5
    on_t0, _ = apply_registration(t1, t1.values > 1, registration, t0)
    assert float(abs(on_t0 - t0).median()) < 3e-5


@pytest.mark.parametrize(
    ("relief", "lean_deg"), [(0.05, 30.0), (0.0, 0.0), (0.0, 30.0)]
)
def test_striae_are_registered_along_both_axes_or_not_at_all(relief, lean_deg):
    stone, spacing, shift = striated(relief, lean_deg), 2 * (SPACING,), (0.040, 0.010)
    t0 = scan(stone, spacing, shape=(128, 128))
    t1 = scan(stone, spacing, shift, shape=(128, 128))
    registration = register(t0, t1, maximum_shift_mm=0.12)
    assert registration.detail_correlation > 0.9
    assert registration.is_reliable == (relief > 0)
    if relief:
        errors = registration.shift_y_error_mm, registration.shift_x_error_mm
        error_mm = SPACING * error_in_elements(registration, np.divide(shift, SPACING))
        assert error_mm < min(0.2e-3, 3 * np.hypot(*errors))


def test_slopes_are_turned_with_the_surface():
    """Otherwise, the steep slopes across striae would hide the flat ones along them."""
    t0, t1 = (scan(striated(0.05), (2e-3, 1e-3), turn_deg=turn) for turn in (0.0, 2.0))
    assert register(t0, t1, maximum_shift_mm=0.05).slope_correlation > 0.99


def test_standard_errors_are_those_of_the_shift():
    """Over scans whose noise differs; along y the stone is smoother, and the shift less sure."""
    stone, shift = rough(4), (0.004, -0.003)

    def stretched(y, x):
        return stone(0.3 * y, x)

    spacing = 2 * (SPACING,)
    exact = [scan(stretched, spacing), scan(stretched, spacing, shift)]
    off, stated = [], []
    for seed in range(8):
        noise = 2e-4 * np.random.default_rng(seed).standard_normal((2, *exact[0].shape))
        found = register(*map(np.add, exact, noise), maximum_shift_mm=0.05)
        off.append((found.shift_y_mm - shift[0], found.shift_x_mm - shift[1]))
        stated.append((found.shift_y_error_mm, found.shift_x_error_mm))
    true, errors = np.sqrt(np.mean(np.square([off, stated]), axis=1))
    assert errors[0] > 2 * errors[1]
    np.testing.assert_allclose(errors / true, 1.0, atol=0.45)


def test_a_bow_does_not_lead_away_from_the_peak_of_the_search(remeasure):
    """An instrument's bow is a longer wave than the details, and many times as high."""
    t0, t1, _ = remeasure(1, (4.0, -3.0))
    y, x = np.indices(t1.shape) / SIZE - 0.5
    bowed = t1 + 300e-3 * (y + 0.2) ** 2 * (x + 0.3)
    registration = register(t0, bowed, maximum_shift_mm=0.05)
    assert error_in_elements(registration, (4.0, -3.0)) < 1.5
    assert registration.detail_correlation > 0.5
