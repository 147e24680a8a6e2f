"""The frame of the square: of three points on the stone."""

import numpy as np
import pytest
import trimesh

from gstlib.errors import ConfigError
from gstlib.surfaces.frames import Frame, find_frame

BALL = trimesh.creation.icosphere(subdivisions=4, radius=20)


def frame_of(points, mesh=BALL):
    return find_frame(points, mesh, size_mm=5.0, source="stone.stl")


@pytest.mark.parametrize("seed", range(3))
def test_coordinates_are_along_the_right_handed_axes_of_the_points(seed):
    rng = np.random.default_rng(seed)
    normal, other, shift = rng.normal(size=(3, 3))
    axes = Frame((0, 0, 0), np.cross(normal, other), normal).axes
    origin = 20 * axes[2] + shift
    along, beside, up = rng.uniform((0.5, -5, 2.5), (5, 5, 5))
    in_square = np.array([[0, 0, 0], [along, 0, 0], [beside, up, 0]])
    points = origin + in_square @ axes
    mesh = BALL.copy().apply_translation(shift)
    frame = frame_of(points.tolist(), mesh)
    assert np.linalg.det(frame.axes) == pytest.approx(1)
    local = rng.normal(scale=30, size=(5, 3))
    np.testing.assert_allclose(frame.to_frame(origin + local @ axes), local, atol=1e-9)


@pytest.mark.parametrize(
    ("points", "match"),
    [
        ([[0, 0, 20], [1, 0, 20], [3, 0.01, 20]], "in line"),
        (
            [[0, 0, 20], [3, 0, 20], [0, 300, 20]],
            r"point 3, \[0, 300, 20\], is 280.* of stone.stl",
        ),
    ],
)
def test_points_that_make_no_frame(points, match):
    with pytest.raises(ConfigError, match=rf"square\.points_mm: .*{match}"):
        frame_of(points)
