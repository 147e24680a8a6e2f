"""Many poses of a stone on another: known sums, and tables of poses."""

import numpy as np
import pandas as pd
import pytest
from contacts import pressed as press
from gstlib.errors import ConfigError
from gstlib.gesture import Gesture, exposure, exposure_table, press_poses, read_poses, stroke_poses
from gstlib.preprocess.leveling import remove_plane
from gstlib.specimen.randomness import smooth_field
from gstlib.surface import make_surface

SIDE, COUNT, AROUND = 2.0, 32, 20
SPACING = SIDE / COUNT
SETTINGS = {"contact_modulus_MPa": 1e4, "tolerance": 1e-8}
OF_PATCHES = {"patch_mm": 1.0, **SETTINGS}
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
    return stroke_poses(stroke_mm=1.0, poses=5, pressure_MPa=20.0).assign(**more)


@pytest.fixture(scope="module")
def pressed():
    poses = stroke(weight=[1.0, 2.0, 0.0, 1.0, 1.0], pressure_MPa=[10.0, 20, 30, 20, 10])
    return poses, press_poses(HEIGHT, Gesture(face(), poses), PATCHES, **OF_PATCHES)


def test_a_pose_is_a_contact_with_the_shifted_face():
    """A shift by whole elements takes the face from beside the square, without interpolation."""
    wide = face()
    pose = stroke().iloc[:1].assign(x_mm=3 * SPACING, y_mm=-2 * SPACING)
    found = press_poses(HEIGHT, Gesture(wide, pose), PATCHES, **OF_PATCHES)
    rows, columns = (slice(AROUND + by, AROUND + by + COUNT) for by in (2, -3))
    # Its plane is taken out, as a hand lets it settle.
    over, _ = remove_plane(HEIGHT.copy(data=wide.values[rows, columns]))
    alone = press(HEIGHT, over, target_pressure_MPa=20.0, **SETTINGS)
    np.testing.assert_allclose(found.pressure_sum, alone.pressure, rtol=1e-4, atol=1e-3)
    assert float(found.displacement[0]) == pytest.approx(float(alone.displacement), rel=1e-6)


def test_forces_are_kept(pressed):
    poses, batch = pressed
    found = exposure([batch])
    total = (poses.weight * poses.pressure_MPa).sum() / poses.weight.sum()
    assert float(found.mean_pressure.mean()) == pytest.approx(total, rel=1e-9)
    np.testing.assert_allclose(found.patch_pressure.mean("patch"), poses.pressure_MPa, rtol=1e-9)
    work = (poses.weight * poses.pressure_MPa * poses.sliding_mm).sum()
    assert float(found.exposure.mean()) == pytest.approx(work, rel=1e-9)
    assert float(found.patch_exposure.sum("pose").mean()) == pytest.approx(work, rel=1e-9)
    assert 0 <= float(found.touched.min()) < float(found.touched.max()) <= 1
    assert (found.highest_pressure >= found.mean_pressure).all()


def test_batches_add_up_to_the_whole(pressed):
    poses, batch = pressed
    parts = [
        press_poses(HEIGHT, Gesture(face(), poses[part]), PATCHES, shown=[0, 4], **OF_PATCHES)
        for part in (slice(2), slice(2, 3), slice(3, 5))
    ]
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
    without = press_poses(HEIGHT, Gesture(face(), poses[poses.weight > 0]), PATCHES, **OF_PATCHES)
    for name in ("pressure_sum", "highest_pressure", "touched_sum", "exposure"):
        scale = float(abs(batch[name]).max())
        np.testing.assert_allclose(without[name], batch[name], atol=1e-3 * scale, err_msg=name)


def test_the_table_has_each_patch_over_the_poses(pressed):
    poses, batch = pressed
    single = PATCHES.assign(pressure_MPa=[1.0, 2.0, 3.0, 4.0])
    table = exposure_table(exposure([batch]), single).set_index("patch")
    assert table.pressure_MPa.tolist() == [1, 2, 3, 4]
    mean = (poses.weight * poses.pressure_MPa).sum() / poses.weight.sum()
    assert table.mean_pressure_MPa.mean() == pytest.approx(mean)
    ordered = table[["lowest_pressure_MPa", "mean_pressure_MPa", "highest_pressure_MPa"]]
    assert (np.diff(ordered, axis=1) > 0).all()
    # the third pose, with the largest pressure, has no weight
    assert table.highest_pressure_MPa.max() < batch.patch_pressure[2].max()


def test_a_turn_slides_farther_out():
    turn = stroke(x_mm=0.0, sliding_mm=0.0, turning_deg=10.0).iloc[:1]
    found = press_poses(HEIGHT, Gesture(face(flat=True), turn), PATCHES, **OF_PATCHES)
    y, x = (found[axis].values - SIDE / 2 for axis in "yx")
    far = np.hypot(y[:, None], x)
    np.testing.assert_allclose(found.exposure, found.pressure_sum * np.radians(10) * far, rtol=1e-9)


def test_on_a_flat_every_pose_is_alike():
    poses = stroke(y_mm=[0.0, 0.1, 0.5, 0.0, 0.0], rotation_deg=[0.0, 0, 0, 20.0, 0])
    pressures = press_poses(HEIGHT, Gesture(face(flat=True), poses), PATCHES, **OF_PATCHES)
    pressures = pressures.patch_pressure
    np.testing.assert_allclose(pressures, pressures[[0] * 5], rtol=1e-4)
    pressures = press_poses(HEIGHT, Gesture(face(), poses), PATCHES, **OF_PATCHES).patch_pressure
    assert float(abs(pressures - pressures[0]).max()) > 1


def test_a_stroke_has_its_middle_in_the_pose():
    along = stroke()
    assert along.x_mm.tolist() == [-0.5, -0.25, 0, 0.25, 0.5]
    assert along.sliding_mm.sum() == pytest.approx(1.0)
    assert (along.weight == 1).all()
    assert (along.pressure_MPa == 20).all()
    assert not along[["y_mm", "rotation_deg", "turning_deg"]].any(axis=None)


TABLE = "x_mm\ty_mm\tpressure_MPa\tsliding_mm\tweight\n0.1\t0\t20\t0.5\t1\n-0.1\t0\t20\t0.5\t2\n"


def test_a_table_of_poses_is_read(tmp_path):
    path = tmp_path / "poses.tsv"
    path.write_text("# a short stroke\n" + TABLE)
    poses = read_poses(path, size_mm=SIDE)
    assert poses.x_mm.tolist() == [0.1, -0.1]
    assert poses.weight.tolist() == [1, 2]
    assert poses.rotation_deg.tolist() == poses.turning_deg.tolist() == [0, 0]
    path.write_text(TABLE.replace("pressure_MPa", "force_N"))
    assert read_poses(path, size_mm=SIDE).pressure_MPa.tolist() == [20 / SIDE**2] * 2


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("weight", "mass", r"missing columns \['weight'\], unknown columns \['mass'\]"),
        ("\t20\t0.5\t2", "\tmuch\t0.5\t2", "pose 2: pressure_MPa is much"),
        ("\t20\t0.5\t2", "\t20\t-1\t2", "pose 2: sliding_mm is -1"),
        ("0.5\t1\n", "0.5\t\n", "pose 1: weight is nan"),
        ("\t20\t0.5\t2", "\t0\t0.5\t2", "one has no pressure"),
        (TABLE[TABLE.index("\n") + 1 :], "", "0 poses"),
    ],
)
def test_a_faulty_table_of_poses_is_refused(tmp_path, old, new, named):
    path = tmp_path / "poses.tsv"
    path.write_text(TABLE.replace(old, new))
    with pytest.raises(ConfigError, match=named) as caught:
        read_poses(path, size_mm=SIDE)
    assert str(path) in str(caught.value)
