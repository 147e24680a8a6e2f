"""The poses that a config asks for, in batches, and how far they move the active tool."""

import numpy as np
import pandas as pd
import pytest
from gst.config.poses import batches_of, reach_of, read_poses
from gstlib.errors import ConfigError

SIDE = 4.0
TABLE = "x_mm\ty_mm\tforce_N\tsliding_mm\tweight\n0.1\t0\t20\t0.5\t1\n-0.1\t0\t20\t0.5\t2\n"


@pytest.mark.parametrize(
    ("text", "force_N"),
    [
        ("# a short stroke\n" + TABLE, 20),
        (TABLE.replace("force_N", "pressure_MPa"), 20 * SIDE**2),
        (TABLE.replace("\t", ";").replace(".", ","), 20),
        (TABLE.replace("force_N", "Force_N"), 20),
    ],
    ids=["N", "MPa", "semicolons", "capitals"],
)
def test_a_table_of_poses_is_read(tmp_path, text, force_N):
    (tmp_path / "poses.csv").write_text(text)
    poses = read_poses(tmp_path / "poses.csv", size_mm=SIDE)
    expected = {"x_mm": [0.1, -0.1], "weight": [1, 2], "rotation_deg": [0, 0]}
    expected |= {"turning_deg": [0, 0], "force_N": [force_N, force_N]}
    assert poses[[*expected]].to_dict("list") == expected


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("weight", "mass", "mass"),
        ("\t20\t0.5\t2", "\tinf\t0.5\t2", "line 3: force_N is 'inf'"),
        ("\t20\t0.5\t2", "\t20\t-1\t2", "line 3: sliding_mm is -1"),
        ("0.5\t1\n", "0.5\t\n", "line 2: weight is empty"),
        ("\t20\t0.5\t2", "\t0\t0.5\t2", "line 3: force_N is 0"),
        ("\t20\t0.5\t2", "\t\t0.5\t2", "line 3: give one of force_N and pressure_MPa"),
        (TABLE, TABLE.replace("5\t2", "5\t0").replace("5\t1", "5\t0"), "no pose has a weight"),
    ],
)
def test_a_faulty_table_of_poses_is_refused(tmp_path, old, new, words):
    path = tmp_path / "poses.tsv"
    path.write_text(TABLE.replace(old, new))
    with pytest.raises(ConfigError, match=words) as caught:
        read_poses(path, size_mm=SIDE)
    assert str(path) in str(caught.value)


def test_the_active_tool_is_needed_as_far_as_the_poses_reach(tmp_path):
    path = tmp_path / "poses.tsv"

    def reach(rows=TABLE, **sections):
        path.write_text(rows)
        config = {"square": {"size_mm": 10.0}, "macroscale": {"face_mm": 12.0}, "gesture": None}
        config |= {"uncertainty": {"pose_um": 0.0}}
        return reach_of(config | {"load": {"force_N": 500.0, "pressure_MPa": None}} | sections)

    assert reach() == 0
    assert reach(uncertainty={"pose_um": 400.0}) == 2
    assert reach(gesture={"stroke_mm": 3.0, "poses": 7}) == 1.5
    gesture = {"table": str(path)}
    assert reach(TABLE.replace("0.1\t0", "3\t4"), gesture=gesture) == 5
    turned = TABLE.replace("x_mm", "rotation_deg\tx_mm").replace("-0.1", "0.1")
    for turn in ("45", "-45"):  # the corners of the face turn with it
        rows = turned.replace("0.1", f"{turn}\t0")
        assert reach(rows, gesture=gesture) == pytest.approx(6 * (np.sqrt(2) - 1))


def test_no_pose_is_lost_between_batches_and_each_keeps_its_number():
    poses = pd.DataFrame({"x_mm": np.arange(450.0)})
    batches = batches_of(poses)
    assert [*batches] == ["1", "2", "3"]
    together = pd.concat(pd.DataFrame(batch) for batch in batches.values())
    pd.testing.assert_frame_equal(together, poses)
    assert batches_of(None) == {}
