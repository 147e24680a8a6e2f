"""One contact of the whole square, and the patches of two scales compared with it."""

import numpy as np
import pytest
import xarray as xr
from contacts import contact_of
from gstlib.coupling.placement import ALL
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface
from gstlib.validation.single_scale import patches_of_reference, two_scales_table

SQUARE, POINTS = 200, 32  # a square of 2 mm, a scan of 0.32 mm, both at 10 µm


def square(values) -> xr.DataArray:
    return make_surface(values, 0.01)


def scan(rows, columns=None) -> xr.DataArray:
    columns = columns or rows
    return make_surface(np.zeros((rows, columns)), (0.01, 0.01 * rows / columns))


def contact(pressure, **slopes) -> xr.Dataset:
    heights = np.arange(POINTS**2, dtype=float).reshape(POINTS, POINTS) * 1e-6
    return contact_of(make_surface(heights, 0.01), pressure, **slopes)


def reference_of(masks) -> xr.Dataset:
    """By draw, with one patch."""
    grid = make_surface(np.zeros((POINTS, POINTS)), 0.01)
    return xr.Dataset(
        {
            "contact": (("draw", "patch", "y", "x"), np.array(masks, bool)[:, None]),
            "pressure": (("draw", "patch"), 7.0 + 2.0 * np.arange(len(masks))[:, None]),
        },
        coords={"patch": ["a"], "y": grid.y, "x": grid.x},
    )


def test_a_scan_reads_the_reference_where_it_lies():
    pressure = np.zeros((SQUARE, SQUARE))
    pressure[120, 80] = 5.0  # y 1.205, x 0.805
    for rotation in (0.0, 30.0):
        place = PatchPosition(1.205, 0.805, rotation)
        found = patches_of_reference(square(pressure), {"a": place}, scan(33))
        at = np.argwhere(found.contact.values[0])
        np.testing.assert_array_equal(at, [[16, 16]])
    turned = PatchPosition(1.205 - 0.05, 0.805 + 0.1, 90.0)  # its x runs along y, its y against x
    found = patches_of_reference(square(pressure), {"a": turned}, scan(33))
    np.testing.assert_array_equal(np.argwhere(found.contact.values[0]), [[26, 21]])
    # a scan of squares, and one of rectangles
    for grid, along_x, column in ((scan(33), 0.05, 21), (scan(33, 11), 0.03, 6)):
        beside = PatchPosition(1.205 - 0.1, 0.805 - along_x, 0.0)
        found = patches_of_reference(square(pressure), {"a": beside}, grid)
        np.testing.assert_array_equal(np.argwhere(found.contact.values[0]), [[26, column]])
        assert float(found.pressure[0]) == pytest.approx(5.0 / grid.size)


def test_points_outside_the_square_are_not_in_contact():
    place = PatchPosition(0.1, 0.1, 0.0)
    found = patches_of_reference(square(np.ones((SQUARE, SQUARE))), {"a": place}, scan(32))
    inside = found.contact.values[0]
    assert inside.any()
    assert not inside.all()
    assert not inside[:5].any()
    assert not inside[:, :5].any()
    assert inside[-1, -1]


def table_of(reference, **contacts):
    """The table by variant and patch; of each variant the contact of patch a."""
    of_patches = {name: {"a": one} for name, one in contacts.items()}
    return two_scales_table(of_patches, reference).set_index(["variant", "patch"])


def test_scores_against_the_reference_by_hand():
    true = np.zeros((POINTS, POINTS), bool)
    true[10, 10:20] = True
    pressure = np.zeros((POINTS, POINTS))
    pressure[10, 15:23] = 100.0  # 5 of 8 are right, 5 of 10 are found
    row = table_of(reference_of([true]), equilibrium=contact(pressure)).loc[("equilibrium", "a")]
    points = POINTS**2
    assert row.precision == pytest.approx(5 / 8)
    assert row.recall == pytest.approx(5 / 10)
    assert row.f1 == pytest.approx(10 / 18)
    assert row.contact_fraction == pytest.approx(8 / points)
    assert row.reference_contact_fraction == pytest.approx(10 / points)
    assert row.reference_pressure_MPa == 7.0
    assert row.pressure_MPa == pytest.approx(pressure.mean())
    none = np.zeros((POINTS, POINTS))
    scores = table_of(reference_of([none]), paper=contact(none))
    assert scores[["precision", "recall", "f1"]].isna().all(axis=None)


def test_the_baseline_marks_the_highest_points_of_the_laid_surface():
    first = np.zeros((POINTS, POINTS), bool)
    first[0] = True
    none = np.zeros((POINTS, POINTS))
    contacts = {"paper": contact(none), "equilibrium": contact(none, slopes=(-1.0, 0.0))}
    # levelled, the last rows are the highest; on the plane, the first
    table = table_of(reference_of([first]), **contacts)
    assert table.f1["highest_equilibrium", "a"] == 1
    assert table.f1["highest_paper", "a"] == 0
    assert table.contact_fraction["highest_equilibrium", "a"] == pytest.approx(1 / POINTS)
    assert np.isnan(table.pressure_MPa["highest_equilibrium", "a"])


def test_draws_and_patches_are_pooled():
    one, other = (np.zeros((POINTS, POINTS), bool) for _ in range(2))
    one[10, 10:14], other[10, 12:20] = True, True
    pressure = np.zeros((POINTS, POINTS))
    pressure[10, 10:14] = 1.0
    table = table_of(reference_of([one, other]), equilibrium=contact(pressure))
    assert table.precision["equilibrium", "a"] == pytest.approx((4 + 2) / 8)
    assert table.recall["equilibrium", "a"] == pytest.approx((4 + 2) / 12)
    assert table.f1["equilibrium", ALL] == table.f1["equilibrium", "a"]
    assert table.reference_pressure_MPa["equilibrium", "a"] == 8.0  # the mean of 7 and 9
