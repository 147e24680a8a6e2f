"""The frame of the square: of three points on the stone."""

import numpy as np
import pytest
import trimesh

from gstlib.errors import ConfigError
from gstlib.surfaces.frames import find_frame


def test_coordinates_are_along_the_right_handed_axes_of_the_points():
    rng = np.random.default_rng(1)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    axes *= np.linalg.det(axes)
    origin = rng.normal(scale=20, size=3)
    points = origin + [[0, 0, 0], [2, 0, 0], [-1, 3, 0]] @ axes
    frame = find_frame(points.tolist(), trimesh.Trimesh(points), size_mm=5.0)
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
    ball = trimesh.creation.icosphere(subdivisions=4, radius=20)
    with pytest.raises(ConfigError, match=rf"square\.points_mm: .*{match}"):
        find_frame(points, ball, size_mm=5.0, source="stone.stl")
