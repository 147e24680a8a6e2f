"""Two tools: halves of a block, spheres, and poses that say the same in two ways."""

import numpy as np
import pytest
import trimesh
from contacts import pressed as press
from gstlib.errors import ConfigError, InputError
from gstlib.macroscale.active_tool import (
    FLAT,
    ActiveTool,
    face_in_pose,
    grid_counterface,
    pose_frame,
    posed_mesh,
)
from gstlib.macroscale.face import grid_macroscale
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.leveling import remove_plane
from scipy.spatial.transform import Rotation

SIDE, COUNT, EDGE = 4.0, 32, 0.125
CORNERS = np.array([(0.0, 0, 0), (SIDE, 0, 0), (0, SIDE, 0)])
SETTINGS = {
    "modulus": 1e4,
    "mean_pressure": 20.0,
    "tolerance": 1e-8,
    "load_point": (SIDE / 2, SIDE / 2),
}


def rough(seed=1, length_mm=0.5):
    """Heights (mm) on the vertices of `sheet`, which is wider than the square."""
    count = round((SIDE + 4) / EDGE) + 1
    return 5e-3 * smooth_field(np.random.default_rng(seed), count, EDGE, length_mm)


def sheet(heights, up=True):
    """An open mesh around the square whose faces look up, or down."""
    along = np.arange(heights.shape[0]) * EDGE - 2
    y, x = np.meshgrid(along, along, indexing="ij")
    # no four vertices on one circle: their triangles would be a matter of rounding
    jitter = np.random.default_rng(0).uniform(-0.02, 0.02, (2, *heights.shape))
    y, x = y + jitter[0], x + jitter[1]
    numbers = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]
    faces = np.concatenate([np.stack(of, -1).reshape(-1, 3) for of in ((a, b, c), (a, c, d))])
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces if up else faces[:, ::-1], process=False)


def motion(seed=4):
    """Some turn and shift (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    matrix[:3, 3] = 30, -20, 10
    return matrix


def at(points, matrix):
    """Points (n, 3) after a motion."""
    return trimesh.transform_points(np.asarray(points, float), matrix)


def pressed(passive, active=None, pose=None, corners=CORNERS):
    """The square with the active tool on it, and its contact at rest."""
    stone = FLAT if active is None else ActiveTool(active, pose, 0.0, "active.ply")
    square, _ = grid_macroscale(
        passive,
        points_mm=np.asarray(corners).tolist(),
        size_mm=SIDE,
        grid=COUNT,
        active_tool=stone,
        source="passive.ply",
        interpolation="linear",
    )
    return square, press(square.height, square.counterface, **SETTINGS)


@pytest.fixture(scope="module")
def block():
    """The two halves of a block that was split along a rough surface; the upper was taken away."""
    heights = rough()
    away = motion()
    return sheet(heights), sheet(heights, up=False).apply_transform(away), away


def poses(away):
    """The pose that puts the upper half back, in two ways."""
    corners = np.array([(SIDE, 0, 0), (0.0, 0, 0), (SIDE, SIDE, 0)])
    return {"points_mm": at(corners, away).tolist(), "matrix": np.linalg.inv(away).tolist()}


@pytest.mark.parametrize("way", ["points_mm", "matrix"])
def test_halves_of_a_block_fit(block, way):
    lower, upper, away = block
    surface, contact = pressed(lower, upper, {way: poses(away)[way]})
    assert np.ptp(surface.height.values) > 0.01
    np.testing.assert_allclose(surface.height + surface.counterface, 0, atol=1e-9)
    assert float(contact.contact_fraction) == 1
    punch = press(0 * surface.height, **SETTINGS)
    np.testing.assert_allclose(contact.pressure, punch.pressure, rtol=1e-4)


@pytest.mark.parametrize("way", ["points_mm", "matrix"])
def test_the_posed_mesh_is_back_in_its_place(block, way):
    lower, upper, away = block
    stone = ActiveTool(upper, {way: poses(away)[way]}, 0.0, "upper.ply")
    back = posed_mesh(stone, frame_from_points(CORNERS), size_mm=SIDE)
    np.testing.assert_allclose(back.vertices, lower.vertices, atol=1e-9)


def test_a_moved_face_is_that_of_a_moved_stone(block):
    lower, _, away = block
    upper = sheet(rough(length_mm=1.5), up=False).apply_transform(away)
    back = np.linalg.inv(away)
    frame = frame_from_points(CORNERS)
    surface, _ = pressed(lower)
    options = {"size_mm": SIDE, "interpolation": "cubic"}
    stone = ActiveTool(upper, {"matrix": back}, 1.5, "active.ply")
    wide = grid_counterface(stone, surface.height, frame, **options)
    middle = (SIDE / 2, SIDE / 2, 0)
    turn = trimesh.transformations.rotation_matrix(np.radians(10), (0, 0, 1), middle)
    for place, turned in (
        (PatchPosition(0.25, -0.5, 0.0), np.eye(4)),
        (PatchPosition(0.1, 0.3, 10.0), turn),
    ):
        there = turned.copy()
        there[:2, 3] += place.x_mm, place.y_mm
        moved = stone._replace(pose={"matrix": there @ back}, reach_mm=0.0)
        expected = grid_counterface(moved, surface.height, frame, **options)
        found = face_in_pose(wide, surface.height, place, size_mm=SIDE)
        # at rest, planes do not matter
        found, expected = remove_plane(found)[0], remove_plane(expected)[0]
        # what lies between the grid's points is interpolated
        misfit = float(np.sqrt(((found - expected) ** 2).mean()))
        assert misfit < (0.02 if place.rotation_deg else 1e-9) * float(expected.std())
    with pytest.raises(InputError, match="farther than its face is known"):
        face_in_pose(wide, surface.height, PatchPosition(0.0, 2.0, 0.0), size_mm=SIDE)


def test_roles_exchanged_give_the_same_pressures_mirrored(block):
    lower, _, away = block
    other = sheet(rough(seed=2), up=False).apply_transform(away)
    square = np.array(poses(away)["points_mm"])
    _, one = pressed(lower, other, {"points_mm": square.tolist()})
    _, two = pressed(other, lower, {"points_mm": CORNERS.tolist()}, corners=square)
    assert 0.02 < float(one.contact_fraction) < 0.9
    scale = float(one.pressure.max())
    np.testing.assert_allclose(two.pressure[:, ::-1], one.pressure, atol=1e-5 * scale)


def moved_by(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return {"matrix": matrix.tolist()}


@pytest.mark.parametrize(
    ("pose", "named"),
    [
        (moved_by(0, 0, 5.0), "away from the passive one"),
        (moved_by(0, 0, -5.0), "in the passive one"),
        (moved_by(50.0, 0, 0), "no part of the mesh lies over the square"),
        (moved_by(4.0, 0, 0), "sticks out of the mesh"),
        ({"points_mm": CORNERS.tolist()}, "point against the frame's normal"),
    ],
)
def test_stones_that_do_not_meet_are_refused(block, pose, named):
    with pytest.raises(InputError, match=named) as caught:
        pressed(block[0], sheet(rough(), up=False), pose)
    assert caught.value.source == "active.ply"
    assert "counterface.pose" in caught.value.remedy


def test_a_pose_that_stretches_or_mirrors_is_refused(block):
    _, upper, _ = block
    frame, options = frame_from_points(CORNERS), {"size_mm": SIDE, "source": "active.ply"}
    for matrix in (np.diag([2.0, 2, 2, 1]), np.diag([1.0, 1, -1, 1])):
        with pytest.raises(ConfigError, match="stretches or mirrors"):
            pose_frame({"matrix": matrix.tolist()}, frame, upper, **options)


def test_points_off_the_active_stone_are_refused_by_their_own_key(block):
    far = np.add(CORNERS, (100, 0, 0)).tolist()
    with pytest.raises(ConfigError, match=r"counterface\.pose\.points_mm.*point 1"):
        pressed(block[0], sheet(rough(), up=False), {"points_mm": far})


def test_a_mesh_coarser_than_the_square_is_refused(block):
    coarse = trimesh.creation.box(
        (12, 12, 1), transform=trimesh.transformations.translation_matrix((2, 2, 0.5))
    )
    with pytest.raises(InputError, match="vertices in the square"):
        pressed(block[0], coarse, {"matrix": np.eye(4).tolist()})
