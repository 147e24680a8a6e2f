"""Two stones: halves of a block, spheres, and poses that say the same in two ways."""

import numpy as np
import pytest
import trimesh
from contacts import hertz
from contacts import pressed as press
from gstlib.counterface import SecondStone, face_in_pose, grid_counterface, posed_mesh
from gstlib.errors import ConfigError, InputError
from gstlib.face import grid_macroscale
from gstlib.geometry import Place, frame_from_points
from gstlib.preprocess.leveling import remove_plane
from gstlib.specimen.randomness import smooth_field
from scipy.spatial.transform import Rotation

SIDE, COUNT, EDGE = 4.0, 32, 0.125
CORNERS = np.array([(0.0, 0, 0), (SIDE, 0, 0), (0, SIDE, 0)])
SETTINGS = {
    "contact_modulus_MPa": 1e4,
    "target_pressure_MPa": 20.0,
    "tolerance": 1e-8,
    "through": (SIDE / 2, SIDE / 2),
}


def rough(seed=1, length_mm=0.5):
    """Heights (mm) on the vertices of `sheet`, which is wider than the square."""
    count = round((SIDE + 4) / EDGE) + 1
    return 5e-3 * smooth_field(np.random.default_rng(seed), count, EDGE, length_mm)


def sheet(heights, up=True, edge=EDGE):
    """An open mesh around the square whose faces look up, or down."""
    along = np.arange(heights.shape[0]) * edge - 2
    y, x = np.meshgrid(along, along, indexing="ij")
    # no four vertices on one circle: their triangles would be a matter of rounding
    jitter = edge * np.random.default_rng(0).uniform(-0.16, 0.16, (2, *heights.shape))
    y, x = y + jitter[0], x + jitter[1]
    numbers = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = numbers[:-1, :-1], numbers[:-1, 1:], numbers[1:, 1:], numbers[1:, :-1]
    faces = np.concatenate([np.stack(of, -1).reshape(-1, 3) for of in ((a, b, c), (a, c, d))])
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, faces if up else faces[:, ::-1], process=False)


def motion():
    """Some turn and shift (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    matrix[:3, 3] = 30, -20, 10
    return matrix


def pressed(passive, active=None, pose=None):
    """The square with the active stone on it, and its contact at rest."""
    stone = None if active is None else SecondStone(active, pose, 0.0, "active.ply")
    square, _ = grid_macroscale(
        passive,
        points_mm=CORNERS.tolist(),
        size_mm=SIDE,
        grid=COUNT,
        second_stone=stone,
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
    points = trimesh.transform_points(corners, away)
    return {"points_mm": points.tolist(), "matrix": np.linalg.inv(away).tolist()}


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
    stone = SecondStone(upper, {way: poses(away)[way]}, 0.0, "upper.ply")
    back = posed_mesh(stone, frame_from_points(CORNERS), size_mm=SIDE)
    np.testing.assert_allclose(back.vertices, lower.vertices, atol=1e-9)


def test_a_moved_face_is_that_of_a_moved_stone(block):
    lower, _, away = block
    upper = sheet(rough(length_mm=1.5), up=False).apply_transform(away)
    back = np.linalg.inv(away)
    frame = frame_from_points(CORNERS)
    surface, _ = pressed(lower)
    options = {"size_mm": SIDE, "interpolation": "cubic"}
    stone = SecondStone(upper, {"matrix": back}, 1.5, "active.ply")
    wide = grid_counterface(stone, surface.height, frame, **options)
    middle = (SIDE / 2, SIDE / 2, 0)
    turn = trimesh.transformations.rotation_matrix(np.radians(10), (0, 0, 1), middle)
    for place, turned in ((Place(0.25, -0.5, 0.0), np.eye(4)), (Place(0.1, 0.3, 10.0), turn)):
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
        face_in_pose(wide, surface.height, Place(0.0, 2.0, 0.0), size_mm=SIDE)


def moved(x, y, z):
    return {"matrix": trimesh.transformations.translation_matrix((x, y, z)).tolist()}


FIXED = moved(0, 0, 0)


def sphere(radius, edge, up=True):
    """The part of a sphere around its top at the middle of the square, or of one above it."""
    mesh = sheet(np.zeros((round(8 / edge) + 1,) * 2), up, edge)
    off = np.hypot(*(mesh.vertices[:, :2] - SIDE / 2).T)
    height = np.sqrt(radius**2 - off**2) - radius
    mesh.vertices[:, 2] = height if up else -height
    return mesh


def test_two_spheres_touch_as_hertz_says():
    """1/R = 1/R₁ + 1/R₂; the error falls with the meshes' edges, at up to 26,000 faces."""
    radius, force = 1 / (1 / 40.0 + 1 / 60.0), SETTINGS["target_pressure_MPa"] * SIDE**2
    _, pressure = hertz(force, radius, SETTINGS["contact_modulus_MPa"])
    errors = []
    for edge in (0.36, 0.18, 0.07):
        _, contact = pressed(sphere(40.0, edge), sphere(60.0, edge, up=False), FIXED)
        at = (np.arange(COUNT) + 0.5) * SIDE / COUNT - SIDE / 2
        off = contact.pressure.values - pressure(at[:, None], at)
        errors.append(float(np.sqrt(np.mean(off**2))) / pressure(0, 0))
    assert errors[0] > 2 * errors[1] > 2 * errors[2]
    assert errors[2] < 0.02


@pytest.mark.parametrize(
    ("pose", "named"),
    [
        (moved(0, 0, 5.0), "away from the passive one"),
        (moved(0, 0, -5.0), "in the passive one"),
        (moved(50.0, 0, 0), "no part of the mesh lies over the square"),
        (moved(4.0, 0, 0), "sticks out of the mesh"),
        ({"points_mm": CORNERS.tolist()}, "point against the frame's normal"),
        (
            {"points_mm": np.add(CORNERS, (100, 0, 0)).tolist()},
            r"counterface\.pose\.points_mm.*point 1",
        ),
        ({"matrix": np.diag([2.0, 2, 2, 1]).tolist()}, "stretches or mirrors"),
        ({"matrix": np.diag([1.0, 1, -1, 1]).tolist()}, "stretches or mirrors"),
    ],
)
def test_stones_that_do_not_meet_are_refused(block, pose, named):
    with pytest.raises((ConfigError, InputError), match=named) as caught:
        pressed(block[0], sheet(rough(), up=False), pose)
    assert "counterface.pose" in str(caught.value)
