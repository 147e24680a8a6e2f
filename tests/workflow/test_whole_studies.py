"""Whole studies, each started anew: for `make test-all`."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from gst.config.tables import TABLES
from gst.share.difference import compare_results, describe_changes
from gstlib.io.tables import read_table

from .conftest import fresh
from .test_tiny_study import ABSENT

pytestmark = pytest.mark.slow

BASELINE = Path(__file__).parents[1] / "baseline"


def test_the_default_study_gives_the_baseline(study):
    """Digit by digit. Where a change is meant, `make baseline` renews the tables."""
    study.config = "config/config.yaml"
    tables = [f"tables/{file.name}" for file in BASELINE.glob("tables/*.csv")]
    listed = {one.file for name, one in TABLES.items() if name not in ABSENT}
    assert set(tables) == listed - {TABLES["pressures"].file}
    study.succeed(*(f"results/{name}" for name in tables))
    changes = compare_results(BASELINE, study.results)
    changes = changes[changes.table != "provenance"]
    assert changes.empty, describe_changes(changes)


def test_one_core_of_an_older_processor_gives_the_same_tables_as_two(finished_tiny, tmp_path):
    """Its sums and functions differ in their last bits; the generated files do not, nor tables."""
    single = fresh(tmp_path / "single")
    extensions = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    single.environment |= {"NPY_DISABLE_CPU_FEATURES": " ".join(extensions)}
    single.environment |= {"OPENBLAS_CORETYPE": "Prescott"}
    single.succeed(cores=1)
    specimen = [study.results / "specimen" for study in (single, finished_tiny)]
    for file in ("mesh.stl", "scans/7_T0.plu", "scans/7_T1.plu"):
        assert (specimen[0] / file).read_bytes() == (specimen[1] / file).read_bytes(), file
    assert single.tables() == finished_tiny.tables()


def test_batches_and_drawn_patches_leave_the_tables_alone(tiny):
    before = tiny.tables()
    tiny.change(max_plotted_patches=2)
    tiny.succeed("--config", "patches_per_job=4")
    assert tiny.tables() == before
    for name in ("patch", "preparation"):
        assert len(list((tiny.results / f"figures/{name}").glob("*.png"))) == 2


def test_measured_files_without_t1(measured):
    """Validation is left out, the rest is whole."""
    table = measured.folder / "config/patches_tiny.tsv"
    table.write_text(re.sub(r"\t[^\t\n]*$", "", table.read_text(), flags=re.MULTILINE))
    measured.succeed()
    absent = ("validation", "registr", "truth")
    assert not [name for name in measured.tables() if name.startswith(absent)]
    pressures = read_table(measured.results / "tables/patch_pressures.csv")
    # a patch with a poor T0/T1 overlap counts when there is no T1
    assert not pressures.reason.fillna("").str.contains("overlap").any()
    page = (measured.results / "index.html").read_text(encoding="utf-8")
    assert "no prediction is compared with wear" in page
    compared = ('class="mark"', "<span>Predicted</span>", "<span>MCC</span>", "Validation</h2>")
    assert not [part for part in compared if part in page]


def test_a_study_that_no_patch_enters(tiny):
    """Its tables have their columns and no rows; figures say so."""
    tiny.change(selection={"minimum_pressure_MPa": 1000.0})
    assert "no patch enters the study" in tiny.succeed()
    for name in ("microscale_summary", "validation_patches"):
        table = pd.read_csv(tiny.results / f"tables/{name}.csv")
        assert table.empty
        assert "patch" in table.columns
    assert "No patch enters the study" in (tiny.results / "index.html").read_text(encoding="utf-8")
