"""Two tools: halves of a block, spheres, and poses that say the same in two ways."""

import numpy as np
import pytest
import trimesh
from mesh_files import sheet
from scipy.spatial.transform import Rotation
from stones import waves
from trimesh.transformations import rotation_matrix, translation_matrix

from gstlib.errors import ConfigError, InputError
from gstlib.macroscale.active_tool import (
    FLAT,
    ActiveTool,
    face_in_pose,
    grid_counterface,
    pose_frame,
    posed_mesh,
    rounded_counterface,
)
from gstlib.macroscale.face import grid_macroscale
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

SIDE, COUNT, EDGE = 4.0, 32, 0.125
MIDDLE = SIDE / 2, SIDE / 2
CORNERS = np.array([(0.0, 0, 0), (SIDE, 0, 0), (0, SIDE, 0)])
FRAME = frame_from_points(CORNERS)
# Some turn and shift, by which the upper half of the block was taken away, and that back.
AWAY = translation_matrix((30, -20, 10))
AWAY[:3, :3] = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
BACK = np.linalg.inv(AWAY)


def half(shortest_mm=0.5, up=True):
    """An open rough mesh around the square, of waves that are at least so long."""
    heights = waves(1, shortest_mm, 4.0, 5e-3)
    return sheet(heights, EDGE, -2.0, SIDE + 2.0, up)


@pytest.mark.parametrize("radius_mm", [0, np.nan, (50.0, 0), np.ones(3)])
def test_a_tool_of_no_radius_is_refused(radius_mm):
    surface = make_surface(np.zeros((4, 4)), 1.0)
    with pytest.raises(InputError, match="Give one radius or two"):
        rounded_counterface(surface, radius_mm, MIDDLE)
    rounded_counterface(surface, np.array([50.0, 20.0]), MIDDLE)


def gridded(passive, active=None, pose=None):
    """The square with the active tool on it."""
    square = {"points_mm": CORNERS.tolist(), "size_mm": SIDE, "grid": COUNT}
    tool = ActiveTool(active, pose, 0.0, "active.ply") if active else FLAT
    return grid_macroscale(passive, active_tool=tool, interpolation="linear", **square)[
        0
    ]


@pytest.fixture(scope="module")
def lower():
    """The lower half of a block that was split along a rough surface."""
    return half()


@pytest.fixture(scope="module")
def upper():
    """The upper half, taken away."""
    return half(up=False).apply_transform(AWAY)


# The corners of the square as they are seen on the upper half.
PICKED = trimesh.transform_points([(SIDE, 0, 0), (0.0, 0, 0), (SIDE, SIDE, 0)], AWAY)


@pytest.mark.parametrize(
    "pose", [{"points_mm": PICKED.tolist()}, {"matrix": BACK.tolist()}]
)
def test_halves_of_a_block_fit(lower, upper, pose):
    square = gridded(lower, upper, pose)
    assert np.ptp(square.height.values) > 0.01
    np.testing.assert_allclose(square.height + square.counterface, 0, atol=1e-9)
    # the mesh that is looked at is back in its place, too
    there = posed_mesh(ActiveTool(upper, pose, 0.0, "upper.ply"), FRAME, size_mm=SIDE)
    np.testing.assert_allclose(there.vertices, lower.vertices, atol=1e-9)


def test_a_moved_face_is_that_of_a_moved_stone(lower):
    height = gridded(lower).height
    upper = half(1.5, up=False).apply_transform(AWAY)
    options = {"size_mm": SIDE, "interpolation": "cubic"}
    stone = ActiveTool(upper, {"matrix": BACK}, 1.5, "active.ply")
    wide = grid_counterface(stone, height, FRAME, **options)
    # what lies between the grid's points is interpolated
    for place, largest in (
        (PatchPosition(0.25, -0.5, 0.0), 1e-9),
        (PatchPosition(0.1, 0.3, 10.0), 0.02),
    ):
        turn = rotation_matrix(np.radians(place.rotation_deg), (0, 0, 1), (*MIDDLE, 0))
        there = translation_matrix((place.x_mm, place.y_mm, 0)) @ turn
        moved = stone._replace(pose={"matrix": there @ BACK}, reach_mm=0.0)
        expected = grid_counterface(moved, height, FRAME, **options)
        face = face_in_pose(wide, height, place, size_mm=SIDE)
        # at rest, planes do not matter
        misfit = (remove_plane(face)[0] - remove_plane(expected)[0]).std()
        assert float(misfit) < largest * float(expected.std())
    with pytest.raises(InputError, match="beyond the known part of its face"):
        face_in_pose(wide, height, PatchPosition(0.0, 2.0, 0.0), size_mm=SIDE)


def moved_by(*shift):
    return {"matrix": translation_matrix(shift).tolist()}


@pytest.mark.parametrize(
    ("pose", "problem"),
    [
        (moved_by(0, 0, 5.0), "away from the passive one"),
        (moved_by(0, 0, -5.0), "in the passive one"),
        (moved_by(4.0, 0, 0), "sticks out of the mesh"),
        ({"points_mm": CORNERS.tolist()}, "point against the frame's normal"),
    ],
)
def test_stones_that_do_not_meet_are_refused(lower, pose, problem):
    with pytest.raises(InputError, match=problem) as caught:
        gridded(lower, half(up=False), pose)
    assert caught.value.source == "active.ply"
    assert "counterface.pose" in caught.value.remedy


@pytest.mark.parametrize(
    ("pose", "problem"),
    [
        ({"matrix": np.diag([2.0, 2, 2, 1])}, "stretches or mirrors"),
        ({"matrix": np.diag([1.0, 1, -1, 1])}, "stretches or mirrors"),
        (
            {"points_mm": np.add(CORNERS, (100, 0, 0))},
            r"counterface\.pose\.points_mm.*point 1",
        ),
    ],
)
def test_what_is_no_pose_is_refused_by_its_key(upper, pose, problem):
    with pytest.raises(ConfigError, match=problem):
        pose_frame(ActiveTool(upper, pose, 0.0, "active.ply"), FRAME, size_mm=SIDE)
