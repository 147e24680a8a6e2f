"""Coupling: forces are shared out without loss, wherever and however a footprint lies."""

import numpy as np
import pytest
from contacts import written
from numpy.testing import assert_allclose

from gstlib.coupling.embedding import surroundings
from gstlib.coupling.pressures import covered_pressures, patch_pressures, stated, unseen
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface

PLACES = written(
    """
    patch, x_mm, y_mm, rotation_deg
    a,     2.4,  2.6,  25
    b,     2.4,  2.6,  0
    """
)


@pytest.mark.parametrize(
    ("shift_mm", "size_mm", "turn"),
    [((-0.4, 0.1), (1.4, 0.7), -35.0), ((0, 0), (3.0, 3.0), 3.0)],
)
def test_a_mean_is_over_what_both_scans_cover(shift_mm, size_mm, turn):
    """By brute force: the points of T0 that T1 shows; T1 need not be as large as T0."""
    values = np.random.default_rng(7).exponential(20.0, (20, 24)).clip(30.0) - 30.0
    pressure = make_surface(values, (0.25, 0.2))  # 5 mm × 4.8 mm
    registration = PLACES[["patch"]].assign(found=[True, False], rotation_deg=turn)
    columns = ["t1_x_um", "t1_y_um", "t1_size_x_um", "t1_size_y_um"]
    registration[columns] = 1e3 * np.array([*shift_mm, *size_mm])
    along = (np.arange(600) + 0.5) / 600 - 0.5
    v, u = np.meshgrid(along, along, indexing="ij")
    turned = np.exp(-1j * np.radians(turn)) * (u + 1j * v - complex(*shift_mm))
    size_x, size_y = size_mm
    inside = (abs(turned.real) < size_x / 2) & (abs(turned.imag) < size_y / 2)
    y, x = PatchPosition(2.6, 2.4, 25.0).points(v[inside], u[inside])
    mean = pressure.values[(y / 0.25).astype(int), (x / 0.2).astype(int)].mean()
    outlines = patch_pressures(pressure, PLACES, size_mm=1.0)
    table = covered_pressures(outlines, pressure, registration, patch_mm=1.0)
    # no T1 of the second was found
    whole = outlines.pressure_MPa[1]
    assert_allclose(table.covered_MPa, [mean, whole], rtol=5e-3)
    assert unseen(table).equals(table.covered_MPa)
    inferred = outlines.assign(leave_one_out_MPa=[outlines.pressure_MPa[0] + 3, np.nan])
    moved = covered_pressures(inferred, pressure, registration, patch_mm=1.0)
    expected = [table.covered_MPa[0] + 3, np.nan]
    assert_allclose(moved.leave_one_out_MPa, expected)
    used = table.assign(leave_one_out_MPa=[7.0, np.nan], stated_MPa=[np.nan, 8.0])
    assert_allclose(unseen(used), [7.0, whole])
    assert_allclose(stated(used), [table.covered_MPa[0], 8.0])


def test_surroundings_sink_a_patch_as_the_forces_outside_it_do():
    """Far from the load, as a point force does: u = F / (π E* r)."""
    field = make_surface(np.zeros((50, 50)), 0.1)
    field[45, 25] = 200.0  # y 4.55, x 2.55
    place = PatchPosition(1.5, 2.5, 30.0)
    sunk = surroundings(field, place, (16, 16), size_mm=0.8, contact_modulus_MPa=1e4)
    along = (np.arange(16) + 0.5) * 0.05 - 0.4
    y, x = place.points(along[:, None], along)
    expected = 200.0 * 0.1**2 / (np.pi * 1e4 * np.hypot(y - 4.55, x - 2.55))
    assert_allclose(sunk, expected, rtol=2e-3)
