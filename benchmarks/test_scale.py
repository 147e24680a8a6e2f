"""The studies that the growth is measured on are studies that the workflow takes."""

import pytest
import yaml
from scale import CONFIG, ROOT, write_study
from snakemake.utils import update_config

from gstlib.config import config_problems
from gstlib.io.patches import read_patches


@pytest.mark.parametrize("patches", [25, 2500])
def test_study_is_valid(tmp_path, monkeypatch, patches):
    folder = tmp_path / "study"
    write_study(patches, folder, scans=False)
    monkeypatch.chdir(folder)
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    update_config(config, yaml.safe_load((folder / CONFIG).read_text()))
    schemas = ROOT / "workflow/schemas"
    assert config_problems(config, schemas / "config.schema.yaml") == []
    table = read_patches(
        config["patches"],
        schema=schemas / "patches.schema.yaml",
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )
    assert len(table) == patches
    assert len(list((folder / "data/scans").iterdir())) == 2 * patches
