"""Coupling: forces are shared out without loss, wherever and however a footprint lies."""

import numpy as np
import pandas as pd
import pytest
from gstlib.bem import HalfSpace
from gstlib.coupling.embedding import surroundings
from gstlib.coupling.pressures import (
    couple_scales,
    covered_pressures,
    patch_pressures,
    stated,
    unseen,
)
from gstlib.macroscale.ensemble import patch_means
from gstlib.surfaces.footprints import PatchPosition, moved, with_t1
from gstlib.surfaces.grid import make_surface
from hypothesis import given, settings
from hypothesis import strategies as st

GRID = make_surface(np.zeros((20, 24)), (0.25, 0.2))  # 5 mm × 4.8 mm


def pressure_field(seed):
    rng = np.random.default_rng(seed)
    values = rng.exponential(20.0, GRID.shape) * (rng.uniform(size=GRID.shape) < 0.3)
    return GRID.copy(data=values)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 1000),
    st.floats(0.4, 2.0),
    st.floats(-1, 1),
    st.floats(-1, 1),
    st.floats(-90, 90),
)
def test_footprints_that_tile_share_out_all_of_the_force(seed, size, shift_x, shift_y, rotation):
    pressure = pressure_field(seed)
    angle = np.radians(rotation)
    count = int(np.ceil(5 / size)) + 2
    places = size * np.stack(np.meshgrid(*2 * [np.arange(-count, count + 1)]), -1).reshape(-1, 2)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    x, y = (places @ turn + (2.4 + shift_x, 2.5 + shift_y)).T
    near = np.hypot(x - 2.4, y - 2.5) < 3.6 + size
    patches = pd.DataFrame({"patch": np.arange(near.sum()), "x_mm": x[near], "y_mm": y[near]})
    patches["rotation_deg"] = rotation
    table = patch_pressures(pressure, patches, size_mm=size)
    total = float(pressure.sum()) * 0.25 * 0.2
    assert table.force_N.sum() == pytest.approx(total, rel=1e-9)
    np.testing.assert_allclose(table.pressure_MPa, table.force_N / size**2)


def test_uniform_pressure_comes_through_and_none_far_from_contact():
    places = pd.DataFrame({"patch": ["a"], "x_mm": [1.234], "y_mm": [3.21], "rotation_deg": 0.0})
    uniform, far = GRID.copy(data=np.full(GRID.shape, 22.0)), GRID.copy()
    far[2, 2] = 50.0
    row, empty = (patch_pressures(p, places, size_mm=0.85).iloc[0] for p in (uniform, far))
    assert row.pressure_MPa == pytest.approx(22.0)
    assert row.peak_pressure_MPa == 22.0
    assert row.force_N == pytest.approx(22.0 * 0.85**2)
    assert empty.pressure_MPa == empty.peak_pressure_MPa == 0
    both = couple_scales(uniform, far, places, patch_mm=0.85).iloc[0]
    assert both.pressure_MPa == row.pressure_MPa
    assert both.square_pressure_MPa == 0


PLACES = pd.DataFrame({"patch": list("ab"), "x_mm": 2.4, "y_mm": 2.6, "rotation_deg": [25.0, 0.0]})


@pytest.mark.parametrize(
    ("shift_mm", "size_mm", "turn"), [((-0.4, 0.1), (1.4, 0.7), -35.0), ((0, 0), (3.0, 3.0), 3.0)]
)
def test_a_mean_is_over_what_both_scans_cover(shift_mm, size_mm, turn):
    """By brute force: the points of T0 that T1 shows; T1 need not be as large as T0."""
    (shift_x, shift_y), (size_x, size_y) = shift_mm, size_mm
    of_t1 = {"t1_x_um": shift_x, "t1_y_um": shift_y, "t1_size_x_um": size_x, "t1_size_y_um": size_y}
    registration = pd.DataFrame({"patch": ["a", "b"], "found": [True, False], "rotation_deg": turn})
    registration = registration.assign(**{name: 1e3 * of for name, of in of_t1.items()})
    pressure = pressure_field(7)
    means = patch_means(pressure, with_t1(PLACES, registration), size_mm=1.0)
    v, u = np.meshgrid(*2 * [(np.arange(600) + 0.5) / 600 - 0.5], indexing="ij")
    turned = np.exp(-1j * np.radians(turn)) * (u - shift_x + 1j * (v - shift_y))
    inside = (abs(turned.real) < size_x / 2) & (abs(turned.imag) < size_y / 2)
    at = 2.4 + 2.6j + np.exp(1j * np.radians(25.0)) * (u + 1j * v)[inside]
    rows, columns = (at.imag / 0.25).astype(int), (at.real / 0.2).astype(int)
    found, whole = means @ pressure.values.ravel()
    assert found == pytest.approx(pressure.values[rows, columns].mean(), rel=5e-3)
    outlines = patch_pressures(pressure, PLACES, size_mm=1.0)
    assert whole == pytest.approx(outlines.pressure_MPa[1], rel=1e-12)  # no T1 was found
    table = covered_pressures(outlines, pressure, registration, patch_mm=1.0)
    np.testing.assert_allclose(table.covered_MPa, [found, whole])
    np.testing.assert_allclose(unseen(table), table.covered_MPa)
    told = table.assign(leave_one_out_MPa=[7.0, np.nan], stated_MPa=[np.nan, 8.0])
    np.testing.assert_allclose(unseen(told), [7.0, whole])
    np.testing.assert_allclose(stated(told), [found, 8.0])


def test_moved_patches_stay_on_the_square():
    patches = pd.DataFrame(
        {"patch": list("123"), "x_mm": [1.0, 4.36, 2.0], "y_mm": [2.0, 3.0, 4.5]}
    )
    square = make_surface(np.zeros((48, 48)), 0.1)
    found = moved(patches.assign(rotation_deg=[0.0, 0.0, 45.0]), (-0.02, 0.03), square, 0.85)
    np.testing.assert_allclose(found.x_mm, [1.03, 4.8 - 0.425, 2.03], rtol=1e-12)
    # the turned one reaches half a diagonal from its centre
    np.testing.assert_allclose(found.y_mm, [1.98, 2.98, 4.8 - 0.425 * np.sqrt(2)], rtol=1e-12)


@pytest.mark.parametrize("rotation", [0.0, 30.0])
def test_surroundings_sink_a_patch_as_the_forces_outside_it_do(rotation):
    """Far from the load, as a point force does: u = F / (π E* r)."""
    field = make_surface(np.zeros((50, 50)), 0.1)
    field[45, 25] = 200.0  # y 4.55, x 2.55
    place = PatchPosition(1.5, 2.5, rotation)
    found = surroundings(field, place, (16, 16), size_mm=0.8, contact_modulus_MPa=1e4)
    along = (np.arange(16) + 0.5) * 0.05 - 0.4
    y, x = place.points(along[:, None], along)
    expected = 200.0 * 0.1**2 / (np.pi * 1e4 * np.hypot(y - 4.55, x - 2.55))
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_pressures_inside_the_outline_are_no_surroundings():
    field = make_surface(np.full((50, 50), 10.0), 0.1)
    inside = surroundings(
        field, PatchPosition(2.5, 2.5, 0.0), (8, 8), size_mm=1.0, contact_modulus_MPa=1e4
    )
    whole = HalfSpace((50, 50), 0.1, 1e4).displacement(field.values)[20:30, 20:30].mean()
    alone = HalfSpace((10, 10), 0.1, 1e4).displacement(np.full((10, 10), 10.0)).mean()
    assert inside.mean() == pytest.approx(whole - alone, rel=5e-3)
