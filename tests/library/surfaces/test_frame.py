"""The frame of the square: of three points on the stone."""

import numpy as np
import pytest
import trimesh
from gstlib.errors import ConfigError, InputError
from gstlib.preprocess.mesh import grid_mesh
from gstlib.surfaces.frames import Frame, find_frame
from hypothesis import given, settings
from hypothesis import strategies as st

SIZE = 5.0


def ask(mesh, points):
    return find_frame(points, mesh, size_mm=SIZE, source="stone.stl")


def square_on_ball(seed):
    """Origin and axes of a square that touches a ball of radius 20 with its centre; the ball."""
    rng = np.random.default_rng(seed)
    normal, other = rng.normal(size=(2, 3))
    axes = Frame((0, 0, 0), np.cross(normal, other), normal).axes
    shift = rng.uniform(-100, 100, 3)
    return shift + [-SIZE / 2, -SIZE / 2, 20] @ axes, axes, ball(shift)


def ball(shift=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=20)
    mesh.apply_translation(shift)
    return mesh


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.tuples(st.floats(0.5, 5), st.floats(-5, 5), st.floats(2.5, 5)))
def test_coordinates_are_along_the_right_handed_axes_of_the_points(seed, places):
    along, beside, up = places
    origin, axes, mesh = square_on_ball(seed)
    points = origin + np.array([[0, 0, 0], [along, 0, 0], [beside, up, 0]]) @ axes
    frame = ask(mesh, points.tolist())
    assert np.linalg.det(frame.axes) == pytest.approx(1)
    local = np.random.default_rng(seed).normal(scale=30, size=(5, 3))
    np.testing.assert_allclose(frame.to_frame(origin + local @ axes), local, atol=1e-9)


def test_points_that_turn_clockwise_are_refused():
    origin, axes, mesh = square_on_ball(1)
    grid = {"size_mm": SIZE, "grid": 20}
    points = origin + SIZE * np.vstack([[0, 0, 0], axes[:2]])
    assert -0.5 < float(grid_mesh(mesh, ask(mesh, points), **grid).height.mean()) < 0
    with pytest.raises(InputError, match=r"Exchange points 2 and 3.*anticlockwise"):
        grid_mesh(mesh, ask(mesh, points[[0, 2, 1]]), **grid)


@pytest.mark.parametrize(
    ("points", "match"),
    [
        ([[0, 0, 20], [1, 0, 20], [3, 0.01, 20]], "in line"),
        ([[0, 0, 20], [0, 0, 20], [0, 3, 20]], "in line, or two of them are the same"),
        (
            [[0, 0, 20], [3, 0, 20], [0, 300, 20]],
            r"point 3, \[0, 300, 20\], is 280.* of stone.stl, which spans .* to \[.*20.0\] mm",
        ),
    ],
)
def test_points_that_make_no_frame(points, match):
    with pytest.raises(ConfigError, match=rf"square\.points_mm: .*{match}"):
        ask(ball(), points)
