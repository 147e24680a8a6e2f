"""The frame of the square in the config: one way to give it, and that one whole."""

from pathlib import Path

import pytest
import yaml

from gstlib.config import check_config
from gstlib.errors import ConfigError

ROOT = Path(__file__).parents[2]
SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"
POINTS = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]]


def check(monkeypatch, **frame):
    monkeypatch.chdir(ROOT)
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    config["square"]["frame"] |= frame
    check_config(config, SCHEMA, source="mine.yaml")


def test_other_ways_to_give_it(monkeypatch, tmp_path):
    (tmp_path / "square.ply").touch()
    check(monkeypatch, points_mm=POINTS)
    check(monkeypatch, marker=str(tmp_path / "square.ply"))
    # what is not used need not fit
    check(monkeypatch, points_mm=POINTS, normal=[1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("frame", "match"),
    [
        ({"points_mm": POINTS, "marker": "square.ply"}, "both points_mm and marker"),
        ({"marker": "nowhere/square.ply"}, "names nowhere/square.ply, which does not exist"),
        ({"points_mm": [*POINTS[:2], [9.0, 0.0, 0.0]]}, "points_mm: .* in line"),
        ({"points_mm": POINTS[:2]}, r"'square\.frame\.points_mm' is .*too short"),
        ({"points_mm": [1.0, 2.0, 3.0]}, r"points_mm\.0' is 1\.0"),
        ({"marker": 3}, r"'square\.frame\.marker' is 3"),
    ],
)
def test_what_is_wrong_with_it(monkeypatch, frame, match):
    with pytest.raises(ConfigError, match=match):
        check(monkeypatch, **frame)
