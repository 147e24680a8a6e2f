"""Names of an earlier version are refused where they would do harm."""

from pathlib import Path

import pytest
import yaml

from gst.config.reading import config_problems
from gst.config.renamed import KEYS
from gst.run.owned import refuse_foreign

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"traces": {"minimum_points": 4}}, "traces is now detection"),
        (
            {"detection": {"minimum_points": 4}},
            "minimum_points is now minimum_cluster_points",
        ),
        (
            {"uncertainty": {"force_fraction": 0.3}},
            "force_fraction is now force_log_sd",
        ),
        ({"coupling": "placed"}, "placed is now equilibrium"),
    ],
)
def test_an_old_key_is_refused_with_the_new_one(old, new):
    config = yaml.safe_load((ROOT / "config/tiny.yaml").read_text()) | old
    assert new in "".join(config_problems(config))


def test_every_new_key_exists():
    text = (ROOT / "config/README.md").read_text("utf-8")
    assert all(f"{new}`" in text for new in KEYS.values())


def test_results_of_the_earlier_version_are_refused_as_a_whole(tmp_path, capsys):
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs/place_patches.json").write_text("{}")
    with pytest.raises(SystemExit) as stopped:
        refuse_foreign([], tmp_path)
    assert stopped.value.code == 2
    assert "earlier version" in capsys.readouterr().err
