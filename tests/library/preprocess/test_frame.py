"""The frame of the square: by axes or by three points, one frame either way."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.errors import ConfigError, InputError
from gstlib.preprocess.frame import Frame, find_frame, frame_from_points
from gstlib.preprocess.gridding import grid_mesh

SIZE = 5.0
AXES = ("x_axis", "y_axis", "normal")


@given(st.lists(st.floats(-50, 50), min_size=3, max_size=3), st.integers(0, 1000))
def test_coordinates_are_along_right_handed_axes(origin, seed):
    rng = np.random.default_rng(seed)
    normal, other = rng.normal(size=(2, 3))
    frame = Frame(origin, np.cross(normal, other), 3 * normal)
    local = rng.normal(scale=30, size=(5, 3))
    points = origin + local @ [getattr(frame, axis) for axis in AXES]
    np.testing.assert_allclose(frame.to_frame(points), local, atol=1e-9)
    assert np.dot(np.cross(frame.x_axis, frame.y_axis), frame.normal) == pytest.approx(1)


def test_typed_digits_are_made_perpendicular():
    frame = Frame((0, 0, 0), (0.7071, 0.7071, 0.001), (0, 0, 2))
    assert np.dot(frame.x_axis, frame.normal) == pytest.approx(0, abs=1e-15)
    assert frame.normal == (0, 0, 1)


@pytest.mark.parametrize(
    ("x_axis", "match"),
    [((1, 0, 0.1), "x_axis and normal enclose 84"), ((0, 0, 0), "an axis has length zero")],
)
def test_bad_axes(x_axis, match):
    with pytest.raises(ConfigError, match=f"square.frame: {match}"):
        Frame((0, 0, 0), x_axis, (0, 0, 1))


def ask(mesh, *, unit="mm", **frame):
    given = {"origin_mm": [0, 0, 0], "x_axis": [1, 0, 0], "normal": [0, 0, 1], "points_mm": None}
    return find_frame(
        {"size_mm": SIZE, "frame": given | frame}, mesh, unit=unit, source="stone.stl"
    )


def square_on_ball(seed):
    """Frame of a square that touches a ball of radius 20 with its centre, three corners, ball."""
    rng = np.random.default_rng(seed)
    centre, other = rng.normal(size=(2, 3))
    normal = centre / np.linalg.norm(centre)
    x_axis = np.cross(normal, other)
    x_axis /= np.linalg.norm(x_axis)
    y_axis, shift = np.cross(normal, x_axis), rng.uniform(-100, 100, 3)
    corner = 20 * normal - SIZE / 2 * (x_axis + y_axis) + shift
    points = corner + SIZE * np.array([0 * x_axis, x_axis, y_axis])
    return Frame(corner, x_axis, normal), points, ball(shift)


def ball(shift=(0, 0, 0)):
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=20)
    mesh.apply_translation(shift)
    return mesh


def assert_same(found, expected):
    for name in ("origin", *AXES):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.tuples(st.floats(0.5, 5), st.floats(-5, 5), st.floats(2.5, 5)))
def test_points_are_the_axes_in_other_words(seed, places):
    along, beside, up = places
    frame, points, mesh = square_on_ball(seed)
    assert_same(ask(mesh, points_mm=points.tolist()), frame)
    x_axis, y_axis = np.array(frame.x_axis), np.array(frame.y_axis)
    edges = [0 * x_axis, along * x_axis, beside * x_axis + up * y_axis]
    assert_same(frame_from_points(points[0] + edges), frame)


@pytest.mark.parametrize("inside_out", [False, True])
def test_points_that_turn_clockwise_are_refused(inside_out):
    _, points, mesh = square_on_ball(1)
    if inside_out:
        mesh.invert()
    grid = {"size_mm": SIZE, "shape": (20, 20), "margin_mm": 1.0}
    surface = grid_mesh(mesh, ask(mesh, points_mm=points.tolist()), **grid).height
    assert -0.5 < float(surface.mean()) < 0
    with pytest.raises(InputError, match=r"exchange points 2 and 3.*anticlockwise"):
        grid_mesh(mesh, ask(mesh, points_mm=points[[0, 2, 1]].tolist()), **grid)


@pytest.mark.parametrize(
    ("points", "unit", "match"),
    [
        ([[0, 0, 20], [1, 0, 20], [3, 0.01, 20]], "mm", "in line"),
        ([[0, 0, 20], [0, 0, 20], [0, 3, 20]], "mm", "in line, or two of them are one"),
        (
            [[0, 0, 20], [3, 0, 20], [0, 300, 20]],
            "mm",
            r"point 3, \[0, 300, 20\], is 280.* of stone.stl, which spans .* to \[.*20.0\] mm",
        ),
        ([[0, 0, 0.2], [0.005, 0, 0.2], [0, 0.005, 0.2]], "m", "a viewer of this mesh shows m"),
    ],
)
def test_points_that_make_no_frame(points, unit, match):
    with pytest.raises(ConfigError, match=match) as caught:
        ask(ball(), points_mm=points, unit=unit)
    assert "square.frame.points_mm" in str(caught.value)
