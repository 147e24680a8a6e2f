"""Many poses of a stone on another: known sums."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import around, tiles
from contacts import pressed as press
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.gesture import (
    Gesture,
    exposure,
    exposure_table,
    press_poses,
    scatter_poses,
    stroke_poses,
)
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.grid import make_surface

SIDE, COUNT, AROUND = 2.0, 32, 20
SPACING = SIDE / COUNT
SETTINGS = {"modulus": 1e4, "tolerance": 1e-8}
OF_PATCHES = {"patch_mm": 1.0, "contact_modulus_MPa": 1e4, "tolerance": 1e-8}
MIDDLE, FORCE = (SIDE / 2, SIDE / 2), 20.0 * SIDE**2
PATCHES = tiles(SIDE)


def field(seed, count):
    rough = smooth_field(np.random.default_rng(seed), count, SPACING, 0.3)
    return 3e-3 * rough.astype(float)


HEIGHT = make_surface(field(1, COUNT), SPACING)


def face(flat=False):
    """Another face, over the square and around it."""
    rough = field(2, COUNT + 2 * AROUND)
    return around(0 * rough if flat else rough, SPACING, AROUND * SPACING)


def stroke(**more):
    return stroke_poses(stroke_mm=1.0, poses=5, force_N=FORCE).assign(**more)


def posed(poses, flat=False, **more):
    """The square under another face in some poses."""
    gesture = Gesture(HEIGHT, face(flat), SIDE, MIDDLE, poses)
    return press_poses(HEIGHT, gesture, PATCHES, **OF_PATCHES | more)


@pytest.fixture(scope="module")
def pressed():
    forces = SIDE**2 * np.array([10.0, 20, 30, 20, 10])
    poses = stroke(weight=[1.0, 2.0, 0.0, 1.0, 1.0], force_N=forces)
    return poses, posed(poses)


def test_a_pose_is_a_contact_at_rest_with_the_shifted_face():
    """A shift by whole elements takes the face from beside the square, without interpolation."""
    pose = stroke().iloc[:1].assign(x_mm=3 * SPACING, y_mm=-2 * SPACING)
    found = posed(pose)
    rows, columns = (slice(AROUND + by, AROUND + by + COUNT) for by in (2, -3))
    over = HEIGHT.copy(data=face().values[rows, columns])
    load_point = MIDDLE[0] - 2 * SPACING, MIDDLE[1] + 3 * SPACING
    alone = press(HEIGHT, over, mean_pressure=20.0, load_point=load_point, **SETTINGS)
    level = press(HEIGHT, over, mean_pressure=20.0, **SETTINGS)
    assert abs(alone.pressure - level.pressure).max() > 10
    np.testing.assert_allclose(found.pressure_sum, alone.pressure, rtol=1e-4, atol=1e-3)
    assert float(found.displacement[0]) == pytest.approx(float(alone.displacement), rel=1e-6)


def test_batches_add_up_to_the_whole(pressed):
    """Of which one has a pose without weight alone."""
    poses, batch = pressed
    parts = [posed(poses[part], shown=[0, 4]) for part in (slice(2), slice(2, 3), slice(3, 5))]
    whole, found = exposure([batch]), exposure(parts)
    assert found.pose.values.tolist() == [0, 1, 2, 3, 4]
    assert found.shown.values.tolist() == [0, 4]
    np.testing.assert_allclose(found.pressure.mean(["y", "x"]), [10, 10], rtol=1e-9)
    assert whole.sizes["shown"] == 0
    for name in ("mean_pressure", "highest_pressure", "touched", "exposure", "patch_pressure"):
        scale = float(abs(whole[name]).max())
        np.testing.assert_allclose(found[name], whole[name], atol=1e-3 * scale, err_msg=name)


def test_the_table_has_each_patch_over_the_poses():
    """By hand; the last pose has no weight, so that it is neither the lowest nor the highest."""
    found = xr.Dataset(
        {
            "weight": ("pose", [1.0, 3.0, 0.0]),
            "patch_pressure": (("pose", "patch"), [[4.0, 0.0], [7.0, 3.0], [1.0, 9.0]]),
            "patch_exposure": (("pose", "patch"), [[2.0, 0.0], [3.0, 1.0], [0.0, 0.0]]),
        },
        coords={"patch": ["b", "a"]},
    )
    single = pd.DataFrame({"patch": ["a", "b"], "pressure_MPa": [8.0, 5.0]})
    table = exposure_table(found, single).set_index("patch")
    assert table.loc["a"].tolist() == pytest.approx([8.0, 2.25, 0.0, 3.0, 0.75, 1.0])
    assert table.loc["b"].tolist() == pytest.approx([5.0, 6.25, 4.0, 7.0, 1.0, 5.0])


def test_a_turn_slides_farther_out():
    turn = stroke(x_mm=0.0, sliding_mm=0.1, turning_deg=10.0).iloc[:1]
    found = posed(turn, flat=True)
    y, x = (found[axis].values - SIDE / 2 for axis in "yx")
    slid = np.hypot(0.1, np.radians(10) * np.hypot(y[:, None], x))
    np.testing.assert_allclose(found.exposure, found.pressure_sum * slid, rtol=1e-9)


def test_a_pose_in_which_the_stone_tips_over_wears_nothing():
    poses = stroke().iloc[:2].assign(x_mm=[0.0, -3 * SIDE])
    there = Gesture(rounded_counterface(HEIGHT, 50.0, MIDDLE), None, SIDE, MIDDLE, poses)
    found = press_poses(HEIGHT, there, PATCHES, **OF_PATCHES)
    assert found.contact_fraction.values[0] > 0
    assert found.contact_fraction.values[1] == 0
    alone = press_poses(HEIGHT, there._replace(poses=poses[:1]), PATCHES, **OF_PATCHES)
    np.testing.assert_array_equal(found.exposure, alone.exposure)


def test_a_stone_without_a_mesh_is_moved_by_its_point_of_force():
    """To move a paraboloid is to tilt it, and at rest it finds its tilt itself."""
    pose, there = stroke().iloc[:1].assign(x_mm=0.2, y_mm=-0.1), (MIDDLE[0] - 0.1, MIDDLE[1] + 0.2)
    gesture = Gesture(rounded_counterface(HEIGHT, 50.0, MIDDLE), None, SIDE, MIDDLE, pose)
    found = press_poses(HEIGHT, gesture, PATCHES, **OF_PATCHES)
    moved = rounded_counterface(HEIGHT, 50.0, there)
    alone = press(HEIGHT, moved, mean_pressure=20.0, load_point=there, **SETTINGS)
    np.testing.assert_allclose(found.pressure_sum, alone.pressure, rtol=1e-4, atol=1e-3)


def test_a_hand_wanders_normally_and_as_its_seed_says():
    settings = {"load_point_scatter_mm": 1.5, "poses": 4000, "force_N": FORCE}
    poses, again, other = (scatter_poses(**settings, seed=seed) for seed in (3, 3, 4))
    pd.testing.assert_frame_equal(poses, again)
    assert not poses.x_mm.equals(other.x_mm)
    points = poses[["x_mm", "y_mm"]]
    np.testing.assert_allclose(points.std(), 1.5, rtol=0.05)
    np.testing.assert_allclose(points.mean(), 0, atol=0.1)
    assert abs(np.corrcoef(points.T)[0, 1]) < 0.05
    # neighbours are near: each contact starts from the one before
    steps = np.hypot(*np.diff(points, axis=0).T).mean()
    shuffled = points.sample(frac=1, random_state=1)
    assert steps < 0.7 * np.hypot(*np.diff(shuffled, axis=0).T).mean()


def test_a_stroke_has_its_middle_in_the_pose():
    along = stroke()
    assert along.x_mm.tolist() == [-0.5, -0.25, 0, 0.25, 0.5]
    assert along.sliding_mm.sum() == pytest.approx(1.0)
    assert (along[["force_N", "weight", "y_mm", "rotation_deg"]] == [FORCE, 1, 0, 0]).all(axis=None)
    assert stroke_poses(stroke_mm=1.0, poses=1, force_N=FORCE).x_mm.tolist() == [0]
