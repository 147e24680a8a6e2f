"""Registration recovers known placements, and says so when it cannot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.errors import InputError
from gstlib.surface import make_surface
from gstlib.validation.change import height_change
from gstlib.validation.registration import apply_registration, register

SPACING = 1.66e-3
FIELD = 256


def error_in_elements(registration, shift):
    found = np.array([registration.shift_y_mm, registration.shift_x_mm]) / SPACING
    return np.abs(found - shift).max()


@pytest.mark.parametrize("share", [0.0, 0.05, 0.15])
@pytest.mark.parametrize("fraction", [(0.0, 0.0), (0.37, -0.44)])
def test_known_shift_is_recovered_within_a_fifth_of_an_element(remeasure, share, fraction):
    shift = np.array([share * FIELD, -0.8 * share * FIELD]) + fraction
    t0, t1, _ = remeasure(shift)
    registration = register(t0, t1, maximum_shift_mm=0.2 * FIELD * SPACING)
    assert registration.found
    assert error_in_elements(registration, shift) < 0.2
    assert abs(registration.rotation_deg) < 0.02
    assert registration.overlap == pytest.approx(
        (1 - abs(shift[0]) / FIELD) * (1 - abs(shift[1]) / FIELD), abs=0.005
    )
    assert registration.correlation > 0.9
    assert 0.2e-3 < registration.residual_mm < 0.6e-3  # both scans' noise: 0.28 µm


def test_wear_does_not_pull_the_alignment(remeasure):
    shift = (20.3, -11.6)
    t0, t1, _ = remeasure(shift, wear=0.3, noise_um=0.05)
    registration = register(t0, t1, maximum_shift_mm=0.1)
    assert error_in_elements(registration, shift) < 0.03


@pytest.mark.parametrize("turn", [0.3, -1.2, 2.0])
def test_rotation_is_recovered(remeasure, turn):
    shift = (20.3, -11.6)
    t0, t1, _ = remeasure(shift, rotation_deg=turn)
    registration = register(t0, t1, maximum_shift_mm=0.1)
    assert registration.rotation_deg == pytest.approx(turn, abs=0.05)
    assert error_in_elements(registration, shift) < 0.2


def test_small_rotation_is_tolerated_without_fitting_it(remeasure):
    t0, t1, _ = remeasure((10.0, 5.0), rotation_deg=0.3)
    registration = register(t0, t1, maximum_shift_mm=0.1, rotation=False)
    assert registration.found
    assert registration.rotation_deg == 0
    assert error_in_elements(registration, (10.0, 5.0)) < 0.3


def test_swapping_the_epochs_reverses_the_shift(remeasure):
    t0, t1, _ = remeasure((12.4, -7.3))
    there = register(t0, t1, maximum_shift_mm=0.1)
    back = register(t1, t0, maximum_shift_mm=0.1)
    assert there.shift_x_mm == pytest.approx(-back.shift_x_mm, abs=0.1 * SPACING)
    assert there.shift_y_mm == pytest.approx(-back.shift_y_mm, abs=0.1 * SPACING)


def test_sixty_percent_off_is_poor_overlap_or_not_found(remeasure):
    shift = (0.6 * FIELD, 0.0)
    t0, t1, _ = remeasure(shift)
    near = register(t0, t1, maximum_shift_mm=0.2 * FIELD * SPACING)
    assert not near.found
    assert near.detail_correlation < 0.4
    far = register(t0, t1, maximum_shift_mm=0.7 * FIELD * SPACING)
    assert far.found
    assert far.overlap == pytest.approx(0.4, abs=0.01)
    assert error_in_elements(far, shift) < 0.2


def test_another_stone_is_not_found(remeasure):
    t0, t1, _ = remeasure((0, 0), other=True)
    assert not register(t0, t1, maximum_shift_mm=0.1).found


def test_coordinates_count_and_shapes_may_differ(remeasure):
    t0, t1, _ = remeasure((8.0, 4.0))
    part = t1.isel(y=slice(30, 230), x=slice(12, 250))
    registration = register(t0, part, maximum_shift_mm=0.1)
    assert error_in_elements(registration, (8.0, 4.0)) < 0.2
    on_grid = apply_registration(part, registration, t0)
    change = (on_grid - t0).values
    assert np.nanmedian(np.abs(change - np.nanmedian(change))) < 0.5e-3


def test_applied_heights_lie_on_the_reference(remeasure):
    t0, t1, _ = remeasure((0.0, 30.5), wear=0.0, noise_um=0.0, tilt=0.0)
    registration = register(t0, t1, maximum_shift_mm=0.1)
    on_grid = apply_registration(t1, registration, t0)
    assert on_grid.dims == t0.dims
    np.testing.assert_array_equal(on_grid.x, t0.x)
    assert np.isnan(on_grid[:, :30]).all()
    assert np.isfinite(on_grid[1:-1, 31:]).all()
    # the epochs were levelled over different areas: a plane stays between them
    change = height_change(t0, on_grid)["change"]
    assert float(change.std()) < 0.02e-3


@settings(max_examples=6, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-1, 1))
def test_unit_of_height_and_datum_do_not_matter(remeasure, scale, datum):
    t0, t1, _ = remeasure((6.2, 3.1))
    plain = register(t0, t1, maximum_shift_mm=0.05)
    scaled = register(
        make_surface(t0.values * scale, SPACING),
        make_surface(t1.values * scale + datum * scale, SPACING),
        maximum_shift_mm=0.05,
    )
    assert scaled.shift_x_mm == pytest.approx(plain.shift_x_mm, abs=0.01 * SPACING)
    assert scaled.shift_y_mm == pytest.approx(plain.shift_y_mm, abs=0.01 * SPACING)


def test_flat_surfaces_are_not_found():
    flat = make_surface(np.zeros((40, 40)), SPACING)
    registration = register(flat, flat, maximum_shift_mm=0.01)
    assert not registration.found


def test_errors_say_what_to_do(remeasure):
    t0, t1, _ = remeasure((0, 0))
    with pytest.raises(InputError, match="spacing"):
        register(t0, make_surface(t1.values, 2 * SPACING), maximum_shift_mm=0.1)
    holed = t1.copy()
    holed[3, 4] = np.nan
    with pytest.raises(InputError, match="1 unmeasured"):
        register(t0, holed, maximum_shift_mm=0.1)
    with pytest.raises(ValueError, match="maximum_shift_mm"):
        register(t0, t1, maximum_shift_mm=0.0)


def test_attributes_are_plain_numbers(remeasure):
    t0, t1, _ = remeasure((3.0, -4.0))
    attrs = register(t0, t1, maximum_shift_mm=0.05).as_attrs()
    assert {"shift_x_um", "shift_y_um", "overlap", "correlation", "residual_um"} <= set(attrs)
    assert attrs["shift_x_um"] == pytest.approx(-4 * 1.66, abs=0.3)
    assert all(isinstance(value, int | float) for value in attrs.values())
