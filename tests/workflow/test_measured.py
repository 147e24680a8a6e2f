"""A study of measured files: what the generated one does not have.

With a mat, a rough counterface, published figures and a claim about the worst worn patches.
"""

import hashlib
import json
import shutil

import numpy as np
import pandas as pd
import pytest
from gstlib.io.store import read_attributes, read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.single_scale import composite_heights

from .conftest import as_measured, assert_stored, fresh, in_memory


@pytest.fixture(scope="module")
def studied(finished_tiny, tmp_path_factory):
    study = as_measured(fresh(tmp_path_factory.mktemp("measured")), finished_tiny)
    (study.folder / "published.csv").write_text(
        "quantity,patch,unit,value\nmean pressure,,MPa,22\npatch pressure,13,MPa,10\n"
    )
    study.change(
        counterface={"scan": "data/scans/5_T0.plu", "radius_mm": 200.0},
        mat={"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0},
        published="published.csv",
        reference_draws=2,
        validation={"expected_worst": ["7", "13"]},
        wear_steps=2,
    )
    study.succeed()
    return study


def test_the_record_holds_every_measured_file(studied):
    record = json.loads((studied.results / "provenance.json").read_text())["inputs"]
    names = "data/mesh.stl", "published.csv", "config/patches_tiny.tsv"
    data = [*studied.folder.glob("data/scans/*.plu"), *(studied.folder / name for name in names)]
    assert len(data) == 15
    assert record == {
        str(file.relative_to(studied.folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in data
    }


def test_its_mat_its_rough_face_and_its_claim_come_through(studied, tmp_path):
    """As the library alone takes them; the page tells of the mat."""
    own, tables = in_memory(studied), studied.results / "tables"
    for stage, name in {"face": "surface", "composite": "composite", "contact": "contact"}.items():
        own.kept[stage,] = read_dataset(studied.results / f"macroscale/{name}.h5")
    own.kept["pressures",] = read_pressures(studied.results / "coupling/pressures.csv")
    own.kept["registration",] = read_table(tables / "registration.csv")
    for patch in ("7", "13"):
        stored = read_dataset(studied.results / f"microscale/1/{patch}.h5")
        found = own.patch_contact(patch)
        np.testing.assert_allclose(stored.counterface, found.counterface, atol=1e-9)
        assert np.ptp(stored.counterface.values) > 5e-3  # no ball, but a rough face
    judged = own.judged(seed=own.config["seed"], resamples=199)
    for name, rows in {"wear": judged["wear"], "validation_summary": judged["summary"]}.items():
        assert_stored(rows, tables / f"{name}.csv", tmp_path)
    assert {"archard", "mat", "yielding"} < set(judged["wear"].model)
    assert "expected_worst(7+13, pressure_MPa)" in set(judged["summary"].statistic)
    page = (studied.results / "index.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert "with a mat of 300 MPa, 300 µm thick, predicts" in page
    assert "Generated specimen" not in page


def test_what_was_not_scanned_is_drawn_anew(studied):
    reference = read_dataset(studied.results / "reference/patches.h5")
    assert reference.sizes["draw"] == 2
    assert abs(np.diff(reference.pressure, axis=0)).max() > 1e-3
    table = read_table(studied.results / "tables/two_scales.csv").set_index(["variant", "patch"])
    pressures = table.reference_pressure_MPa["placed"][reference.patch.values]
    np.testing.assert_allclose(pressures, reference.pressure.mean("draw"), rtol=1e-3, atol=1e-6)
    face, composite = (
        read_dataset(studied.results / f"macroscale/{name}.h5") for name in ("surface", "composite")
    )
    scans = {
        patch: read_dataset(studied.results / f"surfaces/T0/1/{patch}_T0.h5")
        for patch in composite.patch.values.tolist()
    }
    drawn = composite_heights(face, composite, scans, s_filter_um=5.0, seed=1, draw=0)
    first = read_dataset(studied.results / "reference/contact.h5").height
    np.testing.assert_allclose(first, remove_plane(drawn)[0], atol=1e-8)


def test_results_of_other_studies_are_refused(studied):
    own = studied.config
    studied.change(title="another stone", inputs={"mesh": "data/other.stl"})
    shutil.copy2(studied.folder / "data/mesh.stl", studied.folder / "data/other.stl")
    refused = studied.gst("study", studied.config)
    studied.config = own
    assert refused.returncode == 2
    assert "holds the results of another study" in refused.stderr


def test_patches_are_cut_from_larger_scans_that_need_no_unmoulding(measured):
    """Two patches are pieces of one scan; heights stay up, and rows and columns as they are."""
    table = measured.folder / "config/patches_tiny.tsv"
    rows = pd.read_csv(table, sep="\t", comment="#", dtype=str)[:2]
    rows["t0"] = "5_T0.plu"
    rows = rows.drop(columns="t1").assign(crop_x_mm=["0.1", "-0.1"], crop_y_mm=["-0.05", "0.15"])
    rows.to_csv(table, sep="\t", index=False)
    measured.change(
        scans={"size_mm": 0.4, "mould": {"invert": False, "flip": None}},
        preprocessing={"outlier_median_threshold": 1000.0},
    )
    measured.succeed("results-measured/surfaces/T0/1")
    own = in_memory(measured)
    for patch in rows.patch:
        surface = read_dataset(measured.results / f"surfaces/T0/1/{patch}_T0.h5").height
        assert surface.shape == (30, 30)  # of 13.28 µm
        np.testing.assert_allclose(surface, own.prepared(patch, "T0").height, atol=1e-12)


# --- Patches that were scanned twice ---------------------------------------------------------


CHANGE = "results-tiny/change"


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
    assert "measure_detection" not in planned
    assert "results-tiny/surfaces/repeat" not in study.succeed("--dry-run")


def test_repeats_give_the_level_of_detection_of_every_patch(repeated):
    assert "measure_detection" in repeated.planned()
    found = "detection.h5"
    tables = "results-tiny/tables/preprocessing.csv"
    repeated.succeed(f"{CHANGE}/{found}", f"{CHANGE}/1", tables)
    folder = repeated.folder / CHANGE
    measured = read_attributes(folder / found)
    # the noise of two scans of 0.1 µm, less what the laying of one on the other smooths
    assert 0.10 < measured["level_mm2"] ** 0.5 * 1e3 < 0.15
    change = read_dataset(folder / "1/5.h5")
    assert change.attrs["detection"] == "repeat"
    assert found in json.loads(change.attrs["input_sha256"])
    limit = change.level_of_detection.values
    assert np.nanmin(limit) >= 1.96 * measured["level_mm2"] ** 0.5 * (1 - 1e-9)
    done = pd.read_csv(repeated.folder / tables, dtype={"patch": str})
    assert done.epoch[done.patch == "7"].tolist() == ["T0", "T1", "repeat"]
    assert done.epoch[done.patch == "10"].tolist() == ["T0", "repeat"]

    own = in_memory(repeated)  # and so does the study in memory
    assert own.detection() == pytest.approx((measured["level_mm2"], measured["lateral_mm2"]))
    np.testing.assert_allclose(own.change("5").level_of_detection, limit)
