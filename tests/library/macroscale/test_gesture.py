"""Many poses of a stone on another: known sums."""

import numpy as np
from contacts import around, tiles
from contacts import pressed as press
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.gesture import (
    Gesture,
    exposure,
    press_poses,
    scatter_poses,
    stroke_poses,
)
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.grid import make_surface

SIDE, COUNT, AROUND = 2.0, 32, 20
SPACING = SIDE / COUNT
MIDDLE, FORCE = (SIDE / 2, SIDE / 2), 20.0 * SIDE**2


def field(seed, count):
    rough = smooth_field(np.random.default_rng(seed), count, SPACING, 0.3)
    return 3e-3 * rough.astype(float)


HEIGHT = make_surface(field(1, COUNT), SPACING)
# Another face, over the square and around it.
FACE = around(field(2, COUNT + 2 * AROUND), SPACING, AROUND * SPACING)
ROUND = rounded_counterface(HEIGHT, 50.0, MIDDLE)


def stroke(**more):
    return stroke_poses(stroke_mm=1.0, poses=5, force_N=FORCE).assign(**more)


def posed(poses, mesh=FACE, height=HEIGHT, load_point=MIDDLE, shown=()):
    """The square under another face in some poses; under a round one if there is no mesh."""
    gesture = Gesture(ROUND, mesh, SIDE, load_point, poses)
    solving = {"patch_mm": 1.0, "contact_modulus_MPa": 1e4, "tolerance": 1e-8}
    return press_poses(height, gesture, tiles(SIDE), shown=shown, **solving)


def test_a_pose_is_a_contact_at_rest_with_the_shifted_face():
    """A shift by whole elements takes the face from beside the square, without interpolation."""
    pose = stroke(x_mm=3 * SPACING, y_mm=-2 * SPACING).iloc[:1]
    rows, columns = (slice(AROUND + by, AROUND + by + COUNT) for by in (2, -3))
    over = HEIGHT.copy(data=FACE.values[rows, columns])
    load_point = MIDDLE[0] - 2 * SPACING, MIDDLE[1] + 3 * SPACING
    alone = press(HEIGHT, over, mean_pressure=20.0, load_point=load_point)
    pressure = posed(pose).pressure_sum
    assert_allclose(pressure, alone.pressure, rtol=1e-4, atol=1e-3)


def test_the_load_point_turns_with_the_tool():
    """Under half a turn of the tool on a flat, contact and load point turn about the middle."""
    beside = 0.6 * SIDE, 0.55 * SIDE
    tool = rounded_counterface(FACE, 50.0, beside)
    pose = stroke(x_mm=0.0).iloc[:1]
    straight, turned = (
        posed(pose.assign(rotation_deg=angle), tool, 0 * HEIGHT, beside).pressure_sum
        for angle in (0.0, 180.0)
    )
    scale = float(straight.max())
    assert_allclose(turned, straight[::-1, ::-1], atol=0.02 * scale)


def test_batches_add_up_to_the_whole():
    """Of which one has a pose without weight alone."""
    forces = SIDE**2 * np.array([10.0, 20, 30, 20, 10])
    poses = stroke(weight=[1.0, 2.0, 0.0, 1.0, 1.0], force_N=forces)
    batches = slice(2), slice(2, 3), slice(3, 5)
    whole = exposure([posed(poses)])
    parts = exposure([posed(poses[batch], shown=[0, 4]) for batch in batches])
    assert parts.pose.values.tolist() == [0, 1, 2, 3, 4]
    assert parts.shown.values.tolist() == [0, 4]
    assert_allclose(parts.pressure.mean(["y", "x"]), [10, 10], rtol=1e-9)
    for name, expected in whole.drop_dims("shown").items():
        scale = float(abs(expected).max())
        assert_allclose(parts[name], expected, atol=1e-3 * scale)


def test_a_turn_slides_farther_out():
    pose = stroke(x_mm=0.3, sliding_mm=0.1, turning_deg=10.0).iloc[:1]
    fields = posed(pose, mesh=None)
    y, x = (fields[axis].values - SIDE / 2 for axis in "yx")
    slid = np.hypot(0.1, np.radians(10) * np.hypot(y[:, None], x - 0.3))
    assert_allclose(fields.exposure, fields.pressure_sum * slid, rtol=1e-9)


def test_a_pose_in_which_the_stone_tips_over_wears_nothing():
    poses = stroke().iloc[:2].assign(x_mm=[0.0, -3 * SIDE])
    fields = posed(poses, mesh=None)
    assert (fields.contact_fraction.values > 0).tolist() == [True, False]
    alone = posed(poses[:1], mesh=None)
    assert_array_equal(fields.exposure, alone.exposure)


def test_a_hand_wanders_normally_and_as_its_seed_says():
    settings = {"load_point_scatter_mm": 1.5, "poses": 4000, "force_N": FORCE}
    poses, other = (scatter_poses(**settings, seed=seed) for seed in (3, 4))
    assert not poses.x_mm.equals(other.x_mm)
    points = poses[["x_mm", "y_mm"]]
    assert_allclose(points.std(), 1.5, rtol=0.05)
    assert_allclose(points.mean(), 0, atol=0.1)
