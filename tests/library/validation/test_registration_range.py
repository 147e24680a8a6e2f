"""How far off T1 may be: every pair within reach is found, none that is not there."""

import numpy as np
import pytest
import scipy.ndimage

from gstlib.surface import make_surface
from gstlib.validation.registration import Registration, carry_mask, register

SPACING = 1.66e-3
SIZE = 128
SEEDS = range(10)


def scans(seed, shift=(0.0, 0.0), turn_deg=0.0):
    """T0 and T1 of a stone of its own: worn, with spikes, noise and another tilt."""
    rng = np.random.default_rng(seed)
    whole = 2 * SIZE
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(whole) * whole] * 2, indexing="ij"))
    amplitude = np.where(wave > 0, np.maximum(wave, 6) ** -1.8, 0) * (wave < whole / 5)
    stone = np.fft.ifft2(np.fft.fft2(rng.standard_normal((whole, whole))) * amplitude).real
    stone *= 4e-3 / stone.std()
    middle = slice((whole - SIZE) // 2, (whole + SIZE) // 2)
    top = np.quantile(stone[middle, middle], 0.8)
    worn = np.minimum(stone, top + 0.2 * (stone - top))
    y, x = np.indices((SIZE, SIZE)) - (SIZE - 1) / 2
    turn = np.radians(turn_deg)
    rows = np.cos(turn) * y + np.sin(turn) * x + shift[0] + (whole - 1) / 2
    columns = np.cos(turn) * x - np.sin(turn) * y + shift[1] + (whole - 1) / 2
    after = scipy.ndimage.map_coordinates(worn, [rows, columns], order=3, mode="grid-wrap")
    after += SPACING * (2e-3 * x - 1e-3 * y)
    spike = rng.random((2, SIZE, SIZE)) < 0.002
    noise = 0.1e-3 * rng.standard_normal((2, SIZE, SIZE)) + 20e-3 * spike
    return [
        make_surface(h - h.mean() + n, SPACING)
        for h, n in zip((stone[middle, middle], after), noise, strict=True)
    ]


@pytest.mark.parametrize("turn", [0.0, -1.0, 2.0])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.2])
def test_within_a_fifth_of_the_field_and_two_degrees_all_are_found(share, turn):
    for seed in SEEDS:
        way = 2 * np.pi * seed / len(SEEDS) + turn
        shift = share * SIZE * np.array([np.sin(way), np.cos(way)]) + (0.3, -0.4)
        t0, t1 = scans(seed, shift, turn)
        found = register(t0, t1, maximum_shift_mm=0.7 * SIZE * SPACING)
        assert found.found
        error = np.array([found.shift_y_mm, found.shift_x_mm]) / SPACING - shift
        assert np.hypot(*error) < 0.2
        assert found.rotation_deg == pytest.approx(turn, abs=0.05)


@pytest.mark.parametrize("minimum_correlation", [0.5, 0.3])
def test_stones_that_have_nothing_in_common_are_not_found(minimum_correlation):
    surfaces = [scans(100 + seed)[0] for seed in range(9)]
    pairs = [(a, b) for i, a in enumerate(surfaces) for b in surfaces[:i]]
    believed = [
        register(
            *pair, maximum_shift_mm=0.7 * SIZE * SPACING, minimum_correlation=minimum_correlation
        ).found
        for pair in pairs
    ]
    assert len(believed) == 36
    assert not any(believed)


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_beyond_reach_nothing_wrong_is_believed(share):
    for seed in range(4):
        t0, t1 = scans(seed, (share * SIZE, 0.0))
        found = register(t0, t1, maximum_shift_mm=0.7 * SIZE * SPACING)
        error = np.array([found.shift_y_mm, found.shift_x_mm]) / SPACING - (share * SIZE, 0.0)
        # a fifth of the field may still do
        assert not found.found or (share < 0.9 and np.hypot(*error) < 0.2)


def laid(shift, turn_deg=0.0):
    """A registration with a shift in points."""
    return Registration(
        shift_x_mm=shift[1] * SPACING,
        shift_y_mm=shift[0] * SPACING,
        rotation_deg=turn_deg,
        overlap=1.0,
        correlation=1.0,
        detail_correlation=1.0,
        residual_mm=0.0,
        found=True,
    )


@pytest.mark.parametrize(
    ("shift", "rows", "columns"),
    [
        ((2.0, -3.0), [12], [7]),
        ((2.5, -3.0), [12, 13], [7]),
        ((2.5, -3.25), [12, 13], [6, 7]),
        ((0.0, 40.0), [], []),
    ],
)
def test_a_mark_is_carried_to_the_points_it_has_a_part_in(shift, rows, columns):
    like = make_surface(np.zeros((30, 30)), SPACING)
    mask = (like > 1).copy()
    mask[10, 10] = True
    carried = carry_mask(mask, laid(shift), like)
    expected = np.zeros(like.shape, dtype=bool)
    expected[np.ix_(rows, columns)] = True
    np.testing.assert_array_equal(carried, expected)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_narrow_strip_of_common_points_is_refined_too(seed):
    t0, t1 = scans(seed, (0.4, -0.3), 0.5)
    # windows of 64 points, a third of their columns in common
    t0, t1 = t0.isel(x=slice(10, 74), y=slice(32, 96)), t1.isel(x=slice(54, 118), y=slice(32, 96))
    found = register(t0, t1, maximum_shift_mm=0.7 * 64 * SPACING)
    assert found.found
    assert found.rotation_deg == pytest.approx(0.5, abs=0.15)
    assert found.overlap == pytest.approx(20 / 64, abs=0.02)
    # that of the centre of T1's window, 22 columns right of the stone's
    turn = np.radians(0.5)
    shift = np.array([0.4 + 22 * np.sin(turn), -0.3 - 22 * (1 - np.cos(turn))])
    error = np.array([found.shift_y_mm, found.shift_x_mm]) / SPACING - shift
    assert np.hypot(*error) < 0.2
