"""The poses that a config asks for, in batches, and how far they move the active tool."""

import numpy as np
import pandas as pd
import pytest
from gst.poses import batches_of, reach_of

TABLE = "x_mm\ty_mm\tforce_N\tsliding_mm\tweight\n0.1\t0\t20\t0.5\t1\n-0.1\t0\t20\t0.5\t2\n"


def test_the_face_is_known_as_far_as_the_poses_reach(tmp_path):
    config = {"square": {"size_mm": 10.0}, "uncertainty": {"pose_um": 0.0}, "gesture": None}
    config |= {"macroscale": {"face_mm": 12.0}}
    config |= {"load": {"force_N": 500.0, "pressure_MPa": None}}
    assert reach_of(config) == 0
    assert reach_of(config | {"uncertainty": {"pose_um": 400.0}}) == 2
    assert reach_of(config | {"gesture": {"stroke_mm": 3.0, "poses": 7}}) == 1.5
    path = tmp_path / "poses.tsv"
    path.write_text(TABLE.replace("0.1\t0", "3\t4"))
    of_table = config | {"gesture": {"table": str(path)}}
    assert reach_of(of_table) == 5
    path.write_text(TABLE.replace("x_mm", "rotation_deg\tx_mm").replace("0.1", "45\t0"))
    # the corners of the face turn with it
    assert reach_of(of_table) == pytest.approx(6 * (np.sqrt(2) - 1))


def test_no_pose_is_lost_between_batches():
    poses = pd.DataFrame({"x_mm": np.arange(450.0)})
    batches = batches_of(poses)
    assert len(batches) == 3
    pd.testing.assert_frame_equal(pd.concat(batches), poses)
    assert batches_of(None) == []
