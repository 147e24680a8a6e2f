"""The poses that a config asks for, in batches, and how far they move the active tool."""

import numpy as np
import pandas as pd
import pytest
import yaml

from gst.config.poses import batches_of, poses_of, reach_of, read_poses
from gst.config.reading import complete
from gstlib.errors import ConfigError

SIDE = 4.0
TABLE = (
    "x_mm\ty_mm\tforce_N\tsliding_mm\tweight\n0.1\t0\t20\t0.5\t1\n-0.1\t0\t20\t0.5\t2\n"
)


@pytest.mark.parametrize(
    ("column", "force_N"), [("force_N", 20), ("pressure_MPa", 20 * SIDE**2)]
)
def test_a_table_of_poses_is_read(tmp_path, column, force_N):
    path = tmp_path / "poses.csv"
    path.write_text(TABLE.replace("force_N", column))
    poses = read_poses(path, size_mm=SIDE)
    expected = {
        "x_mm": [0.1, -0.1],
        "weight": [1, 2],
        "rotation_deg": [0, 0],
        "turning_deg": [0, 0],
        "force_N": [force_N, force_N],
    }
    assert poses[[*expected]].to_dict("list") == expected


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("0.1\t0\t20\t0.5\t\n", "line 2: weight is empty"),
        ("0.1\t0\t\t0.5\t2\n", "line 2: give one of force_N and pressure_MPa"),
        ("0.1\t0\t20\t0.5\t0\n", "no pose has a weight"),
    ],
)
def test_a_faulty_table_of_poses_is_refused(tmp_path, rows, words):
    path = tmp_path / "poses.tsv"
    path.write_text(f"{TABLE.splitlines()[0]}\n{rows}")
    with pytest.raises(ConfigError, match=rf"(?s)poses\.tsv.*{words}"):
        read_poses(path, size_mm=SIDE)


def test_the_active_tool_is_needed_as_far_as_the_poses_reach(tmp_path):
    path = tmp_path / "poses.tsv"
    usual = """
square: {size_mm: 10.0}
macroscale: {face_mm: 12.0}
load: {force_N: 500.0}
uncertainty: {pose_um: 0.0}
"""

    def reach(changes=""):
        config = complete(yaml.safe_load(usual + changes))
        return reach_of(config, poses_of(config))

    def reach_with(rows):
        path.write_text(rows)
        return reach(f"gesture: {{table: {path}}}")

    assert reach() == 0
    assert reach("uncertainty: {pose_um: 400.0}") == 2
    assert reach("gesture: {stroke_mm: 3.0, poses: 7}") == 1.5
    assert reach_with(TABLE.replace("0.1\t0", "3\t4")) == 5
    # the corners of the face turn with it
    turned = TABLE.replace("x_mm", "rotation_deg\tx_mm")
    turned = turned.replace("-0.1\t0", "-45\t0\t0").replace("0.1\t0", "0\t0\t0")
    assert reach_with(turned) == pytest.approx(6 * (np.sqrt(2) - 1))


def test_no_pose_is_lost_between_batches_and_each_keeps_its_number():
    poses = pd.DataFrame({"x_mm": np.arange(450.0)})
    batches = batches_of(poses)
    assert [*batches] == ["1", "2", "3"]
    parts = [pd.DataFrame(batch) for batch in batches.values()]
    pd.testing.assert_frame_equal(pd.concat(parts), poses)
