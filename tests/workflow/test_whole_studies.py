"""Whole studies, each started anew: for `make test-all`."""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gst.config.tables import TABLES
from gst.share.difference import compare_results, describe_changes
from gstlib.io.tables import read_table

from .conftest import ROOT, fresh
from .test_tiny_study import ABSENT

pytestmark = pytest.mark.slow

BASELINE = Path(__file__).parents[1] / "baseline"
SHARED = ROOT.parent / "shared"


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    """The tables of the default study, and the results."""
    study = fresh(tmp_path_factory.mktemp("default") / "study")
    study.config = "config/config.yaml"
    tables = sorted(file.name for file in BASELINE.glob("tables/*.csv"))
    study.run(*(f"results/tables/{name}" for name in tables))
    return tables, study.results


def test_the_default_study_gives_the_baseline(default):
    """Digit by digit. Where a change is meant, `make baseline` renews the tables."""
    tables, results = default
    listed = {one.file for name, one in TABLES.items() if name not in ABSENT}
    assert {f"tables/{name}" for name in tables} == listed - {TABLES["pressures"].file}
    changes = compare_results(BASELINE, results)
    changes = changes[changes.table != "provenance"]
    assert changes.empty, describe_changes(changes)


def test_the_rules_take_the_memory_that_the_documents_say(default):
    _, results = default
    took = defaultdict(int)
    for log in results.glob("logs/*.log"):
        memory = int(re.findall(r"(\d+) MB of memory", log.read_text("utf-8"))[-1])
        rule = re.sub(r"(_T\d)?(_\d+)?$", "", log.stem)
        took[rule] = max(took[rule], memory)
    assert len(took) > 20
    text = (ROOT / "docs/how-to/cluster.md").read_text("utf-8")
    for rules, memory in re.findall(r"^\| (`.*?) \| (.*?) \|$", text, re.MULTILINE):
        stated_MB = map(float, re.findall(r"(\d+) MB", memory))
        for rule, most in zip(re.findall(r"`(\w+)`", rules), stated_MB, strict=True):
            assert took.pop(rule, most) == pytest.approx(most, rel=0.2), rule
    (others,) = re.findall(r"^\| all others \| (\d+) MB or less", text, re.MULTILINE)
    assert max(took.values()) <= 1.2 * float(others)


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="the measured files are not beside the project"
)
def test_the_measured_stone_is_as_the_evidence_says(tmp_path):
    """Its pressures at rest, and those of the square alone."""
    (tmp_path / "shared").symlink_to(SHARED)
    study, tables = fresh(tmp_path / "study"), {}
    study.config = "config/pebble.yaml"
    for coupling in ("equilibrium", "paper"):
        study.change(coupling=coupling, results=f"results-{coupling}")
        study.run(f"results-{coupling}/tables/patch_intervals.csv")
        tables[coupling] = read_table(study.results / "tables/patch_intervals.csv")
    text = " ".join((ROOT / "docs/explanation/evidence.md").read_text("utf-8").split())
    touched, first, second, alone = re.search(
        r"just touched, by (\S+) MPa\. The intervals of two reach (\d+) and (\d+) MPa.*? "
        r"would have put (\d+) MPa on the first",
        text,
    ).groups()
    rest = tables["equilibrium"]
    (pressure,) = rest.pressure_MPa[rest.pressure_MPa > 0]
    assert f"{pressure:.1f}" == touched
    reached = rest.high_MPa[rest.high_MPa > 1]
    assert [f"{high:.0f}" for high in reached] == [first, second]
    assert rest.pressure_MPa[reached.index[0]] == 0
    assert f"{tables['paper'].pressure_MPa[reached.index[0]]:.0f}" == alone


def test_a_changed_scan_changes_its_own_patch_alone(measured):
    measured.run("--until", "register_patches")
    scan, before = measured.folder / "data/scans/5_T1.plu", measured.fields()
    content = bytearray(scan.read_bytes())
    np.frombuffer(content, "<f4", 64 * 64, 508)[2000] += 0.5
    scan.write_bytes(content)
    measured.run("--until", "register_patches")
    changed = {
        name for name, content in measured.fields().items() if before[name] != content
    }
    assert changed == {"surfaces/T1/1/5_T1.h5", "change/1/5.h5"}


def test_batches_and_drawn_patches_leave_the_tables_alone(tiny):
    before = tiny.tables()
    tiny.change(max_plotted_patches=2)
    tiny.run("--config", "patches_per_job=4")
    assert tiny.tables() == before
    assert len([*tiny.results.glob("figures/patch/*.png")]) == 2


def test_measured_files_without_t1(measured):
    """Validation is left out, the rest is whole."""
    table = measured.folder / "config/patches_tiny.tsv"
    table.write_text(re.sub(r"\t[^\t\n]*$", "", table.read_text(), flags=re.MULTILINE))
    measured.run()
    absent = ("validation", "registr", "truth")
    assert not [name for name in measured.tables() if name.startswith(absent)]
    pressures = read_table(measured.results / "tables/patch_pressures.csv")
    # a patch with a poor T0/T1 overlap counts when there is no T1
    assert not pressures.reason.fillna("").str.contains("overlap").any()
    measured.run("--report", measured.folder / "report.html")
    files = measured.folder / "report.html", measured.results / "index.html"
    report, page = (file.read_text("utf-8") for file in files)
    assert "/index.html" in report
    assert "no prediction is compared with wear" in page
    compared = r'class="mark"|<span>(Predicted|MCC)</span>|Validation</h2>'
    assert not re.search(compared, page)


def test_a_study_that_no_patch_enters(tiny):
    """Its tables have their columns and no rows; figures say so."""
    tiny.change(selection={"minimum_pressure_MPa": 1000.0})
    shown = tiny.run()
    assert "no patch enters the study" in shown
    for name in ("microscale_summary", "validation_patches"):
        table = pd.read_csv(tiny.results / f"tables/{name}.csv")
        assert table.empty
        assert "patch" in table.columns
    cases = read_table(tiny.results / "tables/cases.csv")
    assert cases.patch[cases.case.isin(["grinding", "cap"])].isna().all()
    assert (tiny.results / "figures/overview.png").stat().st_size > 0
    page = (tiny.results / "index.html").read_text("utf-8")
    assert "No patch enters the study" in page
