"""A change reruns what depends on it and nothing else. Only plans are made here."""

import os
import re
import shutil

import pytest

from gst.run.batches import share_out

from .conftest import SNAKEMAKE, printed

# What each change reruns, and steps that it leaves alone; all others where none is named.
CHANGES = {
    "load": (
        {"load": {"force_N": 550.0, "at_mm": [2.0, 3.0]}},
        {
            "solve_macroscale",
            "couple_scales",
            "bound_pressures",
            "solve_reference",
            "score_wear",
        },
        {"solve_square", "compose_surface", "check_placement", "register_patches"},
    ),
    "coupling": (
        {"coupling": "paper"},
        {"grid_macroscale", "solve_macroscale", "couple_scales", "solve_patches"},
        {"prepare_scans", "compose_surface", "solve_reference"},
    ),
    "validation": (
        {"validation": {"resamples": 299}},
        {"score_wear", "draw_validation", "write_page"},
        None,
    ),
    "counterface": (
        {"counterface": {"scan": "face.plu", "radius_mm": 200.0}},
        {"prepare_counterface", "solve_patches", "solve_cases"},
        {"prepare_scans", "solve_macroscale", "couple_scales", "register_patches"},
    ),
}


@pytest.mark.parametrize(("change", "reruns", "stays"), CHANGES.values(), ids=CHANGES)
def test_a_changed_value(tiny, change, reruns, stays):
    shutil.copy2(tiny.results / "specimen/scans/5_T0.plu", tiny.folder / "face.plu")
    tiny.change(**change)
    planned = tiny.planned()
    assert reruns <= planned
    assert planned == reruns if stays is None else planned.isdisjoint(stays)


def test_what_no_step_reads_reruns_nothing_but_the_record(tiny):
    """`provenance.json` has the hash of the patch table."""
    (tiny.results / "specimen/scans/7_T0.plu").touch()
    assert tiny.planned() == set()
    table = tiny.folder / "config/patches_tiny.tsv"
    comment, head, *rows = table.read_text().splitlines()
    rows = [f"{row}\tby hand" for row in rows]
    table.write_text("\n".join([comment, "# by hand", f"{head}\tnote", *rows]))
    assert tiny.planned() == {"write_page"}


# --- Another patch ----------------------------------------------------------------------------


FEW = "--config", "patches_per_job=2", "--until", "register_patches"


# Rows of the patch table and what takes their place; and the patch that is then new.
EDITS = [
    ("7\t", "8\t3.50\t3.50\t7_T0.plu\t7_T1.plu\n7\t", "8"),
    ("13\t2.50", "13\t2.60", None),
]


def test_another_patch_reruns_its_batch_alone(measured):
    """Of what is done patch by patch; the stone under all scans is another."""
    table = measured.folder / "config/patches_tiny.tsv"
    before = table.read_text()
    ids = [line.split("\t")[0] for line in before.splitlines()[2:]]
    measured.run(*FEW)
    steps = (
        "Cleaning the scans at T0",
        "Cleaning the scans at T1",
        "Registering T1 to T0",
    )
    for old, new, patch in EDITS:
        table.write_text(before.replace(f"\n{old}", f"\n{new}"))
        assert table.read_text() != before
        plan = measured.run("--dry-run", *FEW)
        again = set(re.findall(rf"({'|'.join(steps)}): part (\d+)", plan))
        batches = share_out({*ids, patch} - {None}, per_job=2)
        assert len(batches) > 2
        own = [batch for batch, members in batches.items() if patch in members]
        assert again == {(step, batch) for step in steps for batch in own}, new


def test_files_are_checked_before_any_is_read(measured):
    """With a damaged one nothing begins. Once they have passed, a later check moves nothing."""
    scan = measured.folder / "data/scans/13_T0.plu"
    whole = scan.read_bytes()
    scan.write_bytes(whole[:999])
    steps = "prepare_scans", "grid_macroscale"
    assert "13_T0.plu" in measured.run("--until", *steps, code=1)
    assert {file.stem for file in measured.results.glob("logs/*")} == {"check_inputs"}
    scan.write_bytes(whole)
    measured.run("--until", *steps)
    (measured.results / "tables/inputs.csv").unlink()
    again = measured.planned()
    assert "check_inputs" in again
    assert again.isdisjoint({*steps, "pass_inputs"})


# --- What Snakemake does not know -------------------------------------------------------------

SCRIPT = """{first}
from gst.run.logs import run_script


def main(scan, folder, table):
    folder.mkdir(exist_ok=True)
    for file in (folder / "1.txt", table):
        file.write_text(scan.read_text())


run_script(snakemake, main)
"""
SNAKEFILE = """
from pathlib import Path
from gst.run.scheduler import adapt, steps_of

rule all:
    input: "results/second.csv"

rule first:
    input: scan="scan.plu"
    output: folder=directory("results/first"), table="results/first.csv"
    log: "results/logs/first.log"
    script: "first.py"

rule second:
    input: "results/first", scan="results/first.csv"
    output: folder=directory("results/second"), table="results/second.csv"
    log: "results/logs/second.log"
    script: "second.py"

adapt(workflow, steps_of(workflow, Path("results")), Path("results"), [])
"""


def test_a_clock_that_is_wrong_stops_nothing_and_a_failed_import_is_told(tmp_path):
    """An instrument's clock may be years ahead, or that of this machine went back."""
    for name, first in (("first", ""), ("second", "import no_such_package")):
        (tmp_path / f"{name}.py").write_text(SCRIPT.format(first=first))
    (tmp_path / "Snakefile").write_text(SNAKEFILE)
    (scan := tmp_path / "scan.plu").write_text("heights")
    os.utime(scan, (2**31, 2**31))
    command = *SNAKEMAKE, "--cores", "1"
    printed(*command, code=1, cwd=tmp_path)
    assert (tmp_path / "results/first.csv").read_text() == "heights"
    assert (
        "No module named 'no_such_package'"
        in (tmp_path / "results/logs/second.log").read_text()
    )
    (tmp_path / "second.py").write_text(SCRIPT.format(first=""))
    for number in (1, 0):
        text = printed(*command, cwd=tmp_path)
        assert text.count("rule second:") == number
        assert "rule first:" not in text
