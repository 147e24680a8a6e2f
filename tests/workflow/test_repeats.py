"""Patches that were scanned twice without use: a study takes its level of detection from them."""

import json

import numpy as np
import pandas as pd
import pytest
import yaml
from gst.patches import read_patches
from gst.sweep import merged
from gstlib.io.scans import read_scan
from gstlib.io.store import read_attributes, read_dataset
from gstlib.study import Study

REGISTERED = "results-tiny/registered"


@pytest.fixture
def repeated(study):
    """The tiny study, three of whose patches were scanned twice."""
    path = study.folder / "config/patches_tiny.tsv"
    table = pd.read_csv(path, sep="\t", comment="#", dtype=str, keep_default_na=False)
    twice = table.patch.isin(["7", "10", "13"])
    table["repeat"] = np.where(twice, table.patch + "_again.plu", "")
    table.loc[table.patch == "10", "t1"] = ""  # a control
    table.to_csv(path, sep="\t", index=False)
    return study


def test_without_repeats_no_rule_takes_them(study):
    planned = study.planned()
    assert "register_patches" in planned
    assert not {rule for rule in planned if "detection" in rule or "repeat" in rule}


def test_repeats_give_the_level_of_detection_of_every_patch(repeated):
    assert {"prepare_repeat_scans", "measure_detection"} <= repeated.planned()
    found = "of_repeats.h5"
    tables = "results-tiny/tables/preprocessing.csv"
    repeated.succeed(f"{REGISTERED}/{found}", f"{REGISTERED}/5.h5", tables)
    folder = repeated.folder / REGISTERED
    measured = read_attributes(folder / found)
    # the noise of two scans of 0.1 µm, less what the laying of one on the other smooths
    assert 0.10 < measured["level_mm2"] ** 0.5 * 1e3 < 0.15
    change = read_dataset(folder / "5.h5")
    assert change.attrs["detection"] == "repeat"
    assert found in json.loads(change.attrs["input_sha256"])
    limit = change.level_of_detection.values
    assert np.nanmin(limit) >= 1.96 * measured["level_mm2"] ** 0.5 * (1 - 1e-9)
    done = pd.read_csv(repeated.folder / tables, dtype={"patch": str})
    assert done.epoch[done.patch == "7"].tolist() == ["T0", "T1", "repeat"]
    assert done.epoch[done.patch == "10"].tolist() == ["T0", "repeat"]

    # and so does the study in memory
    configs = (repeated.folder / f"config/{name}.yaml" for name in ("config", "tiny"))
    config = merged(*(yaml.safe_load(path.read_text()) for path in configs))
    patches = read_patches(
        repeated.folder / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )
    names = {"T0": "T0", "T1": "T1", "repeat": "again"}
    scans = repeated.results / "specimen/scans"
    own = Study(
        config,
        patches,
        read_mesh=lambda: None,
        read_scan=lambda patch, epoch: read_scan(scans / f"{patch}_{names[epoch]}.plu"),
    )
    assert own.detection() == pytest.approx((measured["level_mm2"], measured["lateral_mm2"]))
    np.testing.assert_allclose(own.change("5").level_of_detection, limit)
