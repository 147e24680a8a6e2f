"""A study of measured files: what the generated one does not have.

With a mat, a rough counterface, published figures and a claim about the worst worn patches.
"""

import hashlib
import json
import os
import shutil

import numpy as np
import pandas as pd
import pytest
from conftest import fresh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.preprocess.filtering import s_filtered
from gstlib.preprocess.leveling import remove_plane
from gstlib.reference import composite_heights
from gstlib.study import wear_stone
from gstlib.surface import spacing_of
from test_tiny_study import pressed_heights, recomputed_residual

MAT = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}


@pytest.fixture(scope="module")
def studied(finished_tiny, tmp_path_factory):
    """The tiny specimen's files as measured ones."""
    study = fresh(tmp_path_factory.mktemp("measured"))
    shutil.copytree(finished_tiny.results / "specimen", study.folder / "data")
    (study.folder / "published.csv").write_text(
        "quantity,patch,unit,value\nmean pressure,,MPa,22\npatch pressure,13,MPa,10\n"
    )
    study.change(
        results="results-measured",
        specimen=None,
        inputs={"mesh": "data/mesh.stl", "mesh_unit": "mm", "scan_folder": "data/scans"},
        counterface={"scan": "data/scans/5_T0.plu", "radius_mm": 200.0},
        mat=MAT,
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


def test_the_patches_are_pressed_by_the_rough_face(studied, finished_tiny):
    """The microscale follows it, all before it stays."""
    flat, rough = finished_tiny.tables(), studied.tables()
    assert rough["patch_pressures.csv"] == flat["patch_pressures.csv"]
    scan = read_dataset(studied.results / "surfaces/5_T0.h5").height
    face = s_filtered(scan, 5.0).values[:, ::-1]
    for file in sorted(studied.results.glob("microscale/*.h5")):
        contact = read_dataset(file)
        # on the plane of the round stone there
        pressed, own = (remove_plane(scan.copy(data=of))[0] for of in (contact.counterface, face))
        np.testing.assert_allclose(pressed, own, atol=1e-12)
        if contact.pressure.any():
            field, delta = contact.pressure.values, float(contact.displacement)
            of = spacing_of(contact), float(contact.contact_modulus)
            assert recomputed_residual(pressed_heights(contact), field, delta, *of) <= 1e-6


def test_a_mat_and_a_ceiling_are_worn_judged_and_told(studied):
    worn = read_table(studied.results / "tables/wear.csv")
    worn = worn.pivot(index="patch", columns="model", values="map_error_um")
    assert (worn.mat != worn.archard).all()
    assert (worn.mat != worn.yielding)[["7", "13"]].all()  # nothing is pressed so hard elsewhere
    rows = read_table(studied.results / "tables/validation_summary.csv")
    rows = rows.set_index(["model", "statistic"])
    fitted = read_dataset(studied.results / "wear/whole_mat.h5")
    assert rows.value["mat", "mat_ratio"] == float(fitted.ratio_of_all)
    page = (studied.results / "index.html").read_text(encoding="utf-8")
    told = page.replace("\xa0", " ")
    assert "with a mat of 300 MPa, 300 µm thick, predicts" in told
    assert "Generated specimen" not in page


def test_the_mat_is_the_one_of_the_config(studied):
    tables = studied.results / "tables"
    contact = read_dataset(studied.results / "macroscale/contact.h5")
    known = read_pressures(tables / "patch_pressures.csv"), read_table(tables / "registration.csv")
    worn = wear_stone(contact, *known, patch_mm=0.85, steps=2, mat=MAT)
    stored = read_dataset(studied.results / "wear/whole_square.h5")
    np.testing.assert_allclose(stored.pressed, worn.path.pressed, rtol=1e-3, atol=1e-9)
    mat = read_dataset(studied.results / "wear/whole_mat.h5")
    np.testing.assert_allclose(mat.pressure, worn.mat.pressure, rtol=1e-3, atol=1e-3)


def test_the_worst_worn_are_compared_with_what_was_claimed(studied):
    rows = read_table(studied.results / "tables/validation_summary.csv").set_index("statistic")
    claim = rows.loc["expected_worst(7+13, pressure_MPa)"]
    assert (claim.value, claim.n) == (1, 2)


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
        patch: read_dataset(studied.results / f"surfaces/{patch}_T0.h5")
        for patch in composite.patch.values.tolist()
    }
    drawn = composite_heights(face, composite, scans, s_filter_um=5.0, seed=1, draw=0)
    first = read_dataset(studied.results / "reference/contact.h5").height
    np.testing.assert_allclose(first, remove_plane(drawn)[0], atol=1e-8)


def test_inputs_that_changed_unseen_and_other_studies_are_refused(studied):
    """By `gst study`: of a scan of the same size and date Snakemake sees nothing."""
    scan = studied.folder / "data/scans/7_T1.plu"
    content, dates = scan.read_bytes(), (scan.stat().st_atime_ns, scan.stat().st_mtime_ns)
    scan.write_bytes(content[:-4] + b"gst.")
    os.utime(scan, ns=dates)
    refused = studied.gst("study", studied.config)
    assert refused.returncode == 2
    assert "touch 'data/scans/7_T1.plu'" in refused.stderr
    scan.write_bytes(content)
    os.utime(scan, ns=dates)
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
    files = [f"results-measured/surfaces/{patch}_T0.h5" for patch in rows.patch]
    measured.succeed(*files)
    content = (measured.folder / "data/scans/5_T0.plu").read_bytes()
    raw = np.frombuffer(content, "<f4", 64 * 64, 508).reshape(64, 64)
    for row, file in zip(rows.itertuples(), files, strict=True):
        surface = read_dataset(measured.folder / file)
        count = len(surface.y)
        assert count == round(0.4 / 13.28e-3)
        first_y, first_x = (
            round((0.42496 + float(centre) - 0.2) / 13.28e-3)
            for centre in (row.crop_y_mm, row.crop_x_mm)
        )
        pieces = []
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y, x = first_y + dy, first_x + dx
                piece = raw[y : y + count, x : x + count].astype(float)
                good = np.abs(piece) < 1e4
                pieces.append(np.corrcoef(piece[good], surface.measured.values[good] * 1e3)[0, 1])
        # within a point of where it should be cut
        assert np.nanmax(pieces) > 0.9999
