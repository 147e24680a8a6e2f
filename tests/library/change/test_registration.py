"""Registration recovers known transformations, and reports when it cannot."""

import numpy as np
import pytest
from gstlib.change.change import height_change
from gstlib.change.registration import Registration, apply_registration, register
from gstlib.errors import InputError
from gstlib.surfaces.grid import make_surface

SPACING = 1.66e-3
SIZE = 128
SEEDS = range(4)


def error_in_elements(registration, shift):
    found = np.array([registration.shift_y_mm, registration.shift_x_mm]) / SPACING
    return np.hypot(*(found - shift))


@pytest.mark.parametrize("turn", [-1.0, 2.0])
@pytest.mark.parametrize("share", [0.0, 0.2])
def test_within_a_fifth_of_the_field_and_two_degrees_all_are_found(scans, share, turn):
    for seed in SEEDS:
        way = 2 * np.pi * seed / len(SEEDS) + turn
        shift = share * SIZE * np.array([np.sin(way), np.cos(way)]) + (0.3, -0.4)
        t0, t1 = scans(seed, shift, turn)
        found = register(t0, t1, maximum_shift_mm=0.7 * SIZE * SPACING)
        assert found.found
        assert error_in_elements(found, shift) < 0.2
        assert found.rotation_deg == pytest.approx(turn, abs=0.05)


def test_stones_that_have_nothing_in_common_are_not_found(scans, monkeypatch):
    """Also not with a lower bound on the correlation, where the overlap is small."""
    monkeypatch.setattr("gstlib.change.search.LEAST_CORRELATION", 0.3)
    surfaces = [scans(100 + seed)[0] for seed in range(6)]
    pairs = [(a, b) for i, a in enumerate(surfaces) for b in surfaces[:i]]
    above_noise = [register(*pair, maximum_shift_mm=0.7 * SIZE * SPACING).found for pair in pairs]
    assert not any(above_noise)


def test_found_are_details_that_correlate_by_a_half(scans):
    """T1 has details of another stone, more and more of them."""
    t0, t1 = scans(1)
    pairs = ((t0, t1 + share * scans(2)[0].values) for share in np.linspace(1.4, 2.1, 8))
    found = [register(*pair, maximum_shift_mm=0.05) for pair in pairs]
    above = np.array([each.detail_correlation for each in found]) - 0.5
    assert -0.06 < above[above < 0].max() < above[above > 0].min() < 0.06
    assert [each.found for each in found] == list(above >= 0)


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_beyond_reach_nothing_wrong_is_believed(scans, share):
    for seed in range(4):
        t0, t1 = scans(seed, (share * SIZE, 0.0))
        found = register(t0, t1, maximum_shift_mm=0.7 * SIZE * SPACING)
        # a fifth of the field may still do
        error = error_in_elements(found, (share * SIZE, 0.0))
        assert not found.found or (share < 0.9 and error < 0.2)


@pytest.mark.parametrize(
    ("shift", "rows", "columns"),
    [
        ((2.0, -3.0), [12], [7]),
        ((2.5, -3.0), [12, 13], [7]),
        ((2.5, -3.25), [12, 13], [6, 7]),
        ((0.0, 40.0), [], []),
    ],
)
def test_a_marked_point_marks_those_interpolated_from_it(shift, rows, columns):
    like = make_surface(np.zeros((30, 30)), SPACING)
    mask = like.values > 1
    mask[10, 10] = True
    shifted = Registration(shift[1] * SPACING, shift[0] * SPACING, 0.0, *8 * [1.0], True)
    _, carried = apply_registration(like, mask, shifted, like)
    expected = np.zeros(like.shape, dtype=bool)
    expected[np.ix_(rows, columns)] = True
    np.testing.assert_array_equal(carried, expected)


def test_applied_heights_lie_on_the_reference(remeasure):
    """The coordinates of both grids count, and their shapes may differ."""
    t0, t1, _ = remeasure((0.0, 30.5), wear=0.0, noise_um=0.0, tilt=0.0)
    part = t1.isel(y=slice(30, 230), x=slice(12, 250))
    registration = register(t0, part, maximum_shift_mm=0.1)
    assert error_in_elements(registration, (0.0, 30.5)) < 0.2
    on_grid, _ = apply_registration(part, part.values > 1, registration, t0)
    assert np.isnan(on_grid[:, :42]).all()
    assert np.isfinite(on_grid[31:229, 43:]).all()
    # the epochs were levelled over different areas: a plane stays between them
    assert float(height_change(t0, on_grid)["change"].std()) < 0.02e-3


def test_neither_unit_nor_datum_nor_wear_matter(remeasure):
    shift = (20.3, -11.6)
    t0, t1, _ = remeasure(shift, wear=0.3, noise_um=0.05)
    for scale, datum in [(1.0, 0.0), (1e-3, -0.5), (1e3, 1.0)]:
        found = register(scale * t0, scale * (t1 + datum), maximum_shift_mm=0.1)
        assert error_in_elements(found, shift) < 0.03


def waves(seed, longest=0.2, count=250):
    """A surface (mm) that can be sampled anywhere (y, x in mm), without interpolation."""
    rng = np.random.default_rng(seed)
    length = np.exp(rng.uniform(np.log(0.012), np.log(longest), count))
    way, phase = rng.uniform(0, 2 * np.pi, (2, count))
    height = length**0.8 * rng.normal(size=count)
    height *= 3e-3 / np.sqrt(np.sum(height**2) / 2)

    def at(y, x, *, striae=False):
        along = np.zeros(count) if striae else np.sin(way)
        angle = 2 * np.pi / length * (along * y[..., None] + np.cos(way) * x[..., None]) + phase
        return np.sum(height * np.sin(angle), axis=-1)

    return at


def measured(heights, spacing, shift=(0.0, 0.0), turn_deg=0.0, noise=0.0, shape=(96, 112)):
    """A scan of `heights` (y, x in mm) whose middle lies at `shift` (mm), turned x towards y."""
    dy, dx = spacing
    y, x = (np.indices(shape) - np.reshape(shape, (2, 1, 1)) / 2 + 0.5) * np.reshape(
        spacing, (2, 1, 1)
    )
    sine, cosine = np.sin(np.radians(turn_deg)), np.cos(np.radians(turn_deg))
    laid = heights(cosine * y + sine * x + shift[0], cosine * x - sine * y + shift[1])
    rng = np.random.default_rng(round(1e6 * abs(shift[0])))
    return make_surface(laid + noise * rng.standard_normal(shape), (dy, dx))


@pytest.mark.parametrize("spacing", [(2e-3, 1e-3), (1.907e-3, 1.634e-3)])
def test_a_turn_is_one_in_mm_on_points_that_are_not_square(spacing):
    stone = waves(1, longest=0.1)
    t0, t1 = (measured(stone, spacing, *place, noise=1e-5) for place in [(), ((0.01, -0.006), 1.5)])
    found = register(t0, t1, maximum_shift_mm=0.05)
    assert found.found
    assert found.rotation_deg == pytest.approx(1.5, abs=0.02)
    assert found.shift_y_mm == pytest.approx(0.01, abs=5e-5)
    assert found.residual_mm < 3e-5
    on_t0, _ = apply_registration(t1, t1.values > 1, found, t0)
    assert float(abs(on_t0 - t0).median()) < 3e-5


@pytest.mark.parametrize(
    ("relief", "lean_deg"), [(0.1, 30.0), (0.03, 0.0), (0.0, 0.0), (0.0, 30.0)]
)
def test_striae_are_found_along_both_axes_or_not_at_all(relief, lean_deg):
    stria, rough = waves(2), waves(3, longest=0.1)
    lean = np.radians(lean_deg)

    def ground(y, x):
        across = np.cos(lean) * x + np.sin(lean) * y
        return stria(y, across, striae=True) + relief * rough(y, x)

    spacing, shift = (1.66e-3, 1.66e-3), (0.040, 0.010)
    t0, t1 = (measured(ground, spacing, at, noise=2e-5, shape=(144, 144)) for at in [(0, 0), shift])
    found = register(t0, t1, maximum_shift_mm=0.12)
    assert found.detail_correlation > 0.9
    assert found.found == (relief > 0)
    if found.found:
        error = np.hypot(found.shift_y_mm - shift[0], found.shift_x_mm - shift[1])
        assert error < 3 * np.hypot(found.shift_y_error_mm, found.shift_x_error_mm)
        assert error < 0.2e-3


def test_standard_errors_are_those_of_the_shift():
    """Over scans whose noise differs; along y the stone is smoother, and the shift less sure."""
    stone = waves(4, longest=0.1)
    flat = lambda y, x: stone(0.3 * y, x)  # noqa: E731
    spacing, shift = (1.66e-3, 1.66e-3), (0.004, -0.003)
    off, stated = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        t0, t1 = (
            s + 2e-4 * rng.standard_normal(s.shape)
            for s in (measured(flat, spacing, at) for at in [(0, 0), shift])
        )
        found = register(t0, t1, maximum_shift_mm=0.05)
        off.append((found.shift_y_mm - shift[0], found.shift_x_mm - shift[1]))
        stated.append((found.shift_y_error_mm, found.shift_x_error_mm))
    true, errors = (np.sqrt(np.mean(np.square(each), axis=0)) for each in (off, stated))
    assert errors[0] > 2 * errors[1]
    np.testing.assert_allclose(errors / true, 1.0, atol=0.45)


def test_a_bow_does_not_lead_away_from_what_the_search_found(scans):
    """An instrument's bow is a longer wave than the details, and many times as high."""
    t0, t1 = scans(3, (4.0, -3.0))
    y, x = np.indices(t1.shape) / len(t1) - 0.5
    bowed = t1 + 60e-3 * (y + 0.2) ** 2 * (x + 0.3)
    found = register(t0, bowed, maximum_shift_mm=0.05)
    assert error_in_elements(found, (4.0, -3.0)) < 1.5
    assert found.detail_correlation > 0.5


def test_flat_surfaces_are_not_found():
    flat = make_surface(np.zeros((40, 40)), SPACING)
    registration = register(flat, flat, maximum_shift_mm=0.01)
    assert not registration.found


def test_errors_say_what_to_do(remeasure):
    t0, t1, _ = remeasure((0, 0))
    with pytest.raises(InputError, match="spacing"):
        register(t0, make_surface(t1.values, 2 * SPACING), maximum_shift_mm=0.1)


@pytest.mark.parametrize(("turn", "corner"), [(-1.0, (64, 200)), (1.5, (250, 130))])
def test_a_patch_is_found_anywhere_in_a_larger_map(remeasure, turn, corner):
    """Of T1, all is searched: the piece around its own middle may be another part of the stone."""
    size = 128
    t0, t1, _ = remeasure((8.0, -5.0), rotation_deg=turn, noise_um=0.05)
    corner = np.minimum(corner, 256 - size - 20) + 10
    piece = t0[corner[0] :, corner[1] :][:size, :size]
    found = register(piece, t1, maximum_shift_mm=0.1)
    assert found.found
    assert found.overlap > 0.97
    on_piece, _ = apply_registration(t1, t1.values > 1, found, piece)
    assert float(abs(height_change(piece, on_piece)["change"]).median()) < 0.2e-3
    assert found.rotation_deg == pytest.approx(turn, abs=0.05)
