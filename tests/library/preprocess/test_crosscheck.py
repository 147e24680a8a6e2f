"""The two ways to grid: their difference is told as it is, and is small where both are right."""

import numpy as np
import pytest
import trimesh
import xarray as xr

from gstlib.preprocess.crosscheck import compare_gridding, gridding_attributes
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_both_ways
from gstlib.surface import make_surface


def surfaces(second):
    """A tilted, rough surface of 1 mm, and another one that `second` makes of it."""
    y, x = np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 1, 30), indexing="ij")
    rough = 0.01 * np.sin(17 * x) * np.cos(13 * y)
    first = make_surface(0.3 + 0.1 * x - 0.2 * y + rough, (0.05, 1 / 30), mesh_points=77)
    other = make_surface(second(first.values), (0.05, 1 / 30), mesh_points=55)
    return xr.Dataset({"height": first, "pierced": other})


def test_same_heights():
    difference, table = compare_gridding(surfaces(lambda heights: heights))
    assert (difference.values == 0).all()
    first, second = table.iloc[0], table.iloc[1]
    assert (first.mesh_points, second.mesh_points) == (77, 55)
    assert first.Sq_um == second.Sq_um == pytest.approx(5, abs=0.2)  # without the tilt
    assert second.rms_difference_um == second.largest_difference_um == 0
    assert second.correlation == pytest.approx(1)


def test_difference_and_its_place(caplog):
    def dented(heights):
        heights = heights.copy()
        heights[4, 9] -= 0.02
        heights[0, 0] = np.nan
        return heights

    difference, table = compare_gridding(surfaces(dented))
    assert difference.attrs["units"] == "mm"
    assert float(difference[4, 9]) == pytest.approx(-0.02)
    row = table.iloc[1]
    assert row.elements == 599
    assert row.largest_difference_um == pytest.approx(20)
    assert (row.x_mm, row.y_mm) == pytest.approx((9.5 / 30, 0.225))
    assert row.rms_difference_um == pytest.approx(20 / np.sqrt(599))
    assert 0.9 < row.correlation < 1
    attributes = gridding_attributes(table)
    assert attributes["gridding_bridged_elements"] == 1
    assert attributes["gridding_largest_difference_um"] == pytest.approx(20)
    assert "the mesh is coarse" in caplog.text


def test_a_shift_of_all_heights_is_a_difference():
    _, table = compare_gridding(surfaces(lambda heights: heights + 0.001))
    assert table.rms_difference_um[1] == pytest.approx(1)
    assert table.highest_um[1] == pytest.approx(table.highest_um[0] + 1)


def test_flat_surface_has_no_correlation():
    flat = make_surface(np.zeros((4, 4)), 1.0, mesh_points=4)
    _, table = compare_gridding(xr.Dataset({"height": flat, "pierced": flat}))
    assert np.isnan(table.correlation).all()


def test_falls_with_the_edges_of_the_mesh():
    found = []
    for subdivisions in (4, 5, 6):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=20)
        gridded = grid_both_ways(
            ball,
            Frame((2.5, 2.5, 20), (-1, 0, 0), (0, 0, 1)),
            size_mm=5.0,
            shape=(60, 60),
            margin_mm=1.5,
        )
        _, table = compare_gridding(gridded)
        found.append(table.rms_difference_um[1])
    assert found[2] < found[1] < found[0]
