"""Many poses of a stone on another: known sums, and tables of poses."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import pressed as press
from gstlib.counterface import rounded_counterface
from gstlib.errors import ConfigError
from gstlib.gesture import (
    Gesture,
    exposure,
    exposure_table,
    press_poses,
    read_poses,
    stroke_poses,
    wander_poses,
)
from gstlib.specimen.randomness import smooth_field
from gstlib.surface import make_surface

SIDE, COUNT, AROUND = 2.0, 32, 20
SPACING = SIDE / COUNT
SETTINGS = {"contact_modulus_MPa": 1e4, "tolerance": 1e-8}
OF_PATCHES = {"patch_mm": 1.0, **SETTINGS}
MIDDLE, FORCE = (SIDE / 2, SIDE / 2), 20.0 * SIDE**2
# Four patches that tile the square.
PATCHES = pd.DataFrame(
    {"patch": list("abcd"), "x_mm": [0.5, 1.5] * 2, "y_mm": [0.5, 0.5, 1.5, 1.5], "rotation_deg": 0}
)


def field(seed, count):
    rough = smooth_field(np.random.default_rng(seed), count, SPACING, 0.3)
    return 3e-3 * rough.astype(float)


HEIGHT = make_surface(field(1, COUNT), SPACING)


def face(flat=False):
    """Another face, over the square and around it."""
    rough = field(2, COUNT + 2 * AROUND)
    wide = make_surface(0 * rough if flat else rough, SPACING)
    return wide.assign_coords({a: wide[a].copy(data=wide[a] - AROUND * SPACING) for a in "yx"})


def stroke(**more):
    return stroke_poses(stroke_mm=1.0, poses=5, force_N=FORCE).assign(**more)


def posed(poses, flat=False, **more):
    """The square under another face in some poses."""
    gesture = Gesture(face(flat), True, SIDE, MIDDLE, poses)
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
    through = MIDDLE[0] - 2 * SPACING, MIDDLE[1] + 3 * SPACING
    alone = press(HEIGHT, over, target_pressure_MPa=20.0, through=through, **SETTINGS)
    level = press(HEIGHT, over, target_pressure_MPa=20.0, **SETTINGS)
    assert abs(alone.pressure - level.pressure).max() > 10
    np.testing.assert_allclose(found.pressure_sum, alone.pressure, rtol=1e-4, atol=1e-3)
    assert float(found.displacement[0]) == pytest.approx(float(alone.displacement), rel=1e-6)


def test_forces_are_kept(pressed):
    poses, batch = pressed
    found = exposure([batch])
    pressure = poses.force_N / SIDE**2
    total = (poses.weight * pressure).sum() / poses.weight.sum()
    assert float(found.mean_pressure.mean()) == pytest.approx(total, rel=1e-9)
    np.testing.assert_allclose(found.patch_pressure.mean("patch"), pressure, rtol=1e-9)
    work = (poses.weight * pressure * poses.sliding_mm).sum()
    assert float(found.exposure.mean()) == pytest.approx(work, rel=1e-9)
    assert float(found.patch_exposure.sum("pose").mean()) == pytest.approx(work, rel=1e-9)
    assert 0 <= float(found.touched.min()) < float(found.touched.max()) <= 1
    assert (found.highest_pressure >= found.mean_pressure).all()


def test_batches_add_up_to_the_whole(pressed):
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


def test_a_pose_without_weight_leaves_nothing(pressed):
    poses, batch = pressed
    without = posed(poses[poses.weight > 0])
    for name in ("pressure_sum", "highest_pressure", "touched_sum", "exposure"):
        scale = float(abs(batch[name]).max())
        np.testing.assert_allclose(without[name], batch[name], atol=1e-3 * scale, err_msg=name)


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
    turn = stroke(x_mm=0.0, sliding_mm=0.0, turning_deg=10.0).iloc[:1]
    found = posed(turn, flat=True)
    y, x = (found[axis].values - SIDE / 2 for axis in "yx")
    far = np.hypot(y[:, None], x)
    np.testing.assert_allclose(found.exposure, found.pressure_sum * np.radians(10) * far, rtol=1e-9)


def test_under_a_flat_a_turn_changes_nothing_and_a_shift_moves_the_point_of_force():
    poses = stroke(x_mm=0.0, y_mm=[0.0, 0, 0.3, 0.3, 0], rotation_deg=[0.0, 20, 0, -30, 90])
    pressures = posed(poses, flat=True).patch_pressure
    for alike in ([0, 1, 4], [2, 3]):
        np.testing.assert_allclose(pressures[alike[1:]], pressures[alike[:1] * (len(alike) - 1)])
    # patches a and b lie below the middle, c and d above it
    above = pressures[:, 2:].sum("patch") - pressures[:, :2].sum("patch")
    assert float(above[2]) > float(above[0]) + 10
    rough = posed(poses).patch_pressure
    assert float(abs(rough[1] - rough[0]).max()) > 1


@pytest.mark.parametrize("radius_mm", [None, 50.0])
def test_a_stone_without_a_mesh_is_moved_by_its_point_of_force(radius_mm):
    """To move a paraboloid is to tilt it, and at rest it finds its tilt itself."""
    over = rounded_counterface(HEIGHT, radius_mm, MIDDLE)
    pose = stroke().iloc[:1].assign(x_mm=0.2, y_mm=-0.1)
    gesture = Gesture(over, False, SIDE, MIDDLE, pose)
    found = press_poses(HEIGHT, gesture, PATCHES, **OF_PATCHES)
    moved = rounded_counterface(HEIGHT, radius_mm, (MIDDLE[0] - 0.1, MIDDLE[1] + 0.2))
    loading = {"target_pressure_MPa": 20.0, "through": (MIDDLE[0] - 0.1, MIDDLE[1] + 0.2)}
    alone = press(HEIGHT, moved, **loading, **SETTINGS)
    np.testing.assert_allclose(found.pressure_sum, alone.pressure, rtol=1e-4, atol=1e-3)


def test_a_hand_wanders_normally_and_as_its_seed_says():
    settings = {"wander_mm": 1.5, "poses": 4000, "force_N": FORCE}
    poses, again, other = (wander_poses(**settings, seed=seed) for seed in (3, 3, 4))
    pd.testing.assert_frame_equal(poses, again)
    assert not poses.x_mm.equals(other.x_mm)
    points = poses[["x_mm", "y_mm"]]
    np.testing.assert_allclose(points.std(), 1.5, rtol=0.05)
    np.testing.assert_allclose(points.mean(), 0, atol=0.1)
    assert abs(np.corrcoef(points.T)[0, 1]) < 0.05
    assert (poses[["force_N", "sliding_mm", "weight"]] == [FORCE, 1, 1]).all(axis=None)
    assert not poses[["rotation_deg", "turning_deg"]].any(axis=None)
    # neighbours are near: each contact starts from the one before
    steps = np.hypot(*np.diff(points, axis=0).T).mean()
    shuffled = points.sample(frac=1, random_state=1)
    assert steps < 0.7 * np.hypot(*np.diff(shuffled, axis=0).T).mean()
    still = wander_poses(wander_mm=0.0, poses=3, force_N=FORCE, seed=3)
    assert not still[["x_mm", "y_mm"]].any(axis=None)


def test_a_wandering_hand_spreads_what_is_touched():
    """Over the poses the same force and sliding; more is touched, and less of it always."""
    over = rounded_counterface(HEIGHT, 50.0, MIDDLE)
    found = []
    for wander_mm in (0.0, 0.2):
        poses = wander_poses(wander_mm=wander_mm, poses=8, force_N=FORCE, seed=1)
        gesture = Gesture(over, False, SIDE, MIDDLE, poses)
        batches = [press_poses(HEIGHT, gesture, PATCHES, **OF_PATCHES)]
        found.append(exposure(batches))
    still, wandering = found
    for one in found:
        assert float(one.exposure.mean()) == pytest.approx(8 * 20.0, rel=1e-9)
    assert set(np.unique(still.touched)) == {0, 1}
    assert (wandering.touched > 0).sum() > 1.1 * (still.touched > 0).sum()
    assert (wandering.touched == 1).sum() < 0.9 * (still.touched == 1).sum()
    ranges = (np.ptp(one.patch_pressure.values, axis=0) for one in found)
    narrow, wide = ranges
    assert narrow.max() < 0.01 < wide.max()


def test_a_stroke_has_its_middle_in_the_pose():
    along = stroke()
    assert along.x_mm.tolist() == [-0.5, -0.25, 0, 0.25, 0.5]
    assert along.sliding_mm.sum() == pytest.approx(1.0)
    assert (along.weight == 1).all()
    assert (along.force_N == FORCE).all()
    assert not along[["y_mm", "rotation_deg", "turning_deg"]].any(axis=None)
    assert stroke_poses(stroke_mm=1.0, poses=1, force_N=FORCE).x_mm.tolist() == [0]


TABLE = "x_mm\ty_mm\tforce_N\tsliding_mm\tweight\n0.1\t0\t20\t0.5\t1\n-0.1\t0\t20\t0.5\t2\n"


def test_a_table_of_poses_is_read(tmp_path):
    path = tmp_path / "poses.tsv"
    path.write_text("# a short stroke\n" + TABLE)
    poses = read_poses(path, size_mm=SIDE)
    assert poses.x_mm.tolist() == [0.1, -0.1]
    assert poses.weight.tolist() == [1, 2]
    assert poses.rotation_deg.tolist() == poses.turning_deg.tolist() == [0, 0]
    assert poses.force_N.tolist() == [20, 20]
    path.write_text(TABLE.replace("force_N", "pressure_MPa"))
    assert read_poses(path, size_mm=SIDE).force_N.tolist() == [20 * SIDE**2] * 2


@pytest.mark.parametrize("mark", [";", "\t"])
def test_a_table_of_poses_may_have_decimal_commas(tmp_path, mark):
    path = tmp_path / "poses.csv"
    path.write_text(TABLE.replace("\t", mark).replace(".", ","))
    poses = read_poses(path, size_mm=SIDE)
    assert poses.x_mm.tolist() == [0.1, -0.1]
    assert poses.sliding_mm.tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("weight", "mass", r"missing columns \['weight'\], unknown columns \['mass'\]"),
        ("force_N", "Force_N", "Write force_N for Force_N"),
        ("force_N", "pressure_mpa", "Write pressure_MPa for pressure_mpa"),
        ("\t20\t0.5\t2", "\tmuch\t0.5\t2", "pose 2: force_N is much"),
        ("\t20\t0.5\t2", "\t20\t-1\t2", "pose 2: sliding_mm is -1"),
        ("0.5\t1\n", "0.5\t\n", "pose 1: weight is nan"),
        ("\t20\t0.5\t2", "\t0\t0.5\t2", "one has no force"),
        (TABLE[TABLE.index("\n") + 1 :], "", "0 poses"),
        (TABLE, "x_mm,y_mm,force_N,sliding_mm,weight\n0,1,0,20,0,5,1\n", "decimal commas"),
    ],
)
def test_a_faulty_table_of_poses_is_refused(tmp_path, old, new, named):
    path = tmp_path / "poses.tsv"
    path.write_text(TABLE.replace(old, new))
    with pytest.raises(ConfigError, match=named) as caught:
        read_poses(path, size_mm=SIDE)
    assert str(path) in str(caught.value)
