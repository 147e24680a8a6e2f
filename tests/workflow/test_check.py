"""Bad input: all problems at once, in clear errors, by `make check` and before a run begins."""

import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from gst.cli import main
from gstlib.errors import NOTE
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of

from .conftest import ROOT, as_measured, in_memory, run


@pytest.fixture
def check(monkeypatch, caplog):
    """`gst check` of a study: its exit code, and all that it says."""

    def check(study, *options):
        monkeypatch.chdir(study.folder)
        caplog.set_level(NOTE)
        caplog.clear()
        result = CliRunner().invoke(main, ["check", study.config, *options])
        assert isinstance(result.exception, SystemExit | None)
        return result.exit_code, result.output + caplog.text

    return check


def absent(words, text):
    """The words that a text lacks, and a traceback that it has."""
    return [word for word in words if word not in text] + ["Traceback"] * ("Traceback" in text)


def test_good_files(measured, check):
    measured.change(load={"force_N": 550.0, "at_mm": [3.2, 2.0]})
    code, text = check(measured)
    assert code == 0, text
    plane = in_memory(measured).contact.interface.plane
    # of the mesh alone
    (tilt,) = map(float, re.findall(r"tilted by ([\d.]+) mrad", text))
    assert tilt == pytest.approx(1e3 * np.hypot(plane.slope_y, plane.slope_x), rel=0.2)
    words = ("x 3.2, y 2 mm", "E* = 10346 MPa", "64 × 64 points", "mm along its x, y, z", "1 note")
    assert absent(words, text) == []
    names = {file.name for file in measured.results.iterdir()}
    assert names == {"check.png", ".gst_outputs"}


@pytest.mark.parametrize(
    ("load", "code", "words"),
    [
        ({"force_N": 550.0, "at_mm": [0.05, 0.05]}, 2, ("the stone tips over", "load.at_mm")),
        ({"force_N": 550.0, "at_mm": [1.0, 1.0]}, 0, ("of the edge", "1 warning")),
        ({"force_N": 0.1, "at_mm": [0.6, 4.4]}, 0, ("no patch is touched",)),
    ],
)
def test_an_odd_load_is_told(measured, check, load, code, words):
    face_mm, radius_mm = (5.0, 50.0) if load["force_N"] > 1 else (10.0, 20.0)
    measured.change(
        load=load, macroscale={"face_mm": face_mm}, counterface={"radius_mm": radius_mm}
    )
    result = check(measured)
    assert (result[0], absent(words, result[1])) == (code, [])


def test_a_flip_that_is_wrong_is_named_and_cured(study, check):
    """Where the mesh is fine enough to show the patches' waves."""
    fine = {"mesh_edge_mm": 0.3, "cut_off_wavelength_mm": 0.6}
    study.change(specimen=fine, scans={"mould": {"flip": "y"}})
    study.succeed("results-tiny/specimen/mesh.stl")
    as_measured(study, study)
    given = study.config
    study.change(accept=["placement"])
    assert "1 accepted fault" in check(study)[1]
    study.change(accept=[])
    code, text = check(study, "--fix", "--yes")
    assert (code, absent(["et scans.mould.flip to x"], text)) == (0, [])
    assert (study.folder / f"{given}.bak").exists()
    code, text = check(study)
    assert (code, "scans.mould.flip" in text) == (0, False)


def exchange(study, one, other):
    """Two scans."""
    first, second = ((study.folder / f"data/scans/{name}.plu") for name in (one, other))
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def test_scans_of_other_patches_and_epochs_are_told(measured, check):
    for names in (("5_T0", "5_T1"), ("7_T0", "7_T1"), ("10_T1", "11_T1")):
        exchange(measured, *names)
    code, text = check(measured)
    assert code == 2
    words = "patches 5, 7: more rose than fell", "10_T1.plu: as T1 of patch 10", "11_T1.plu"
    assert absent(words, text) == []


def test_an_accepted_fault_is_told_by_the_check_and_by_the_step(measured, check):
    scans = measured.folder / "data/scans"
    shutil.copy(scans / "5_T0.plu", scans / "5_T1.plu")
    table = "results-measured/tables/inputs.csv"
    assert "accept: [same_scan:5]" in measured.run(table).stderr
    measured.change(accept=["same_scan:5"])
    assert "ACCEPTED FAULT: data/scans/5_T1.plu" in measured.succeed(table)
    code, text = check(measured)
    assert (code, absent(["1 accepted fault"], text)) == (0, [])


def test_everything_wrong_with_the_files_is_reported_at_once(measured, check):
    """By the check, and by the first step of a run, which leaves nothing half made."""
    data = measured.folder / "data"
    for file in data.glob("scans/7_T?.plu"):
        file.write_bytes(file.read_bytes()[:3000])
    for file in data.glob("scans/13_T?.plu"):  # the whole square needs one grid
        heights = read_scan(file)
        write_plu(file, heights.values[::2, ::2], 2 * spacing_of(heights)[1])
    mesh = data / "mesh.stl"
    trimesh.load_mesh(mesh).apply_scale(1e-3).export(mesh)
    measured.change(interlayer={"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 9.0})
    words = [
        "4 problems",
        "interlayer.thickness_um",
        "reference_realisations",
        "mesh_unit",
        "truncated",
    ]
    words += ["data/mesh.stl", "7_T0.plu", "7_T1.plu", "13_T0.plu"]
    result = measured.run()
    for code, text in (check(measured), (result.returncode, result.stdout + result.stderr)):
        assert code > 0
        assert absent(words, text) == []
    assert not [file for file in measured.results.rglob("*") if file.suffix in (".h5", ".csv")]


def test_files_that_are_missing_do_not_hide_faults_of_the_others(measured, check):
    (measured.folder / "data/mesh.stl").unlink()
    (measured.folder / "data/scans/5_T1.plu").unlink()
    measured.change(scans={"size_mm": 0.5}, results="config/patches_tiny.tsv/results")
    code, text = check(measured)
    words = ["data/mesh.stl does not exist", "5_T1.plu does not exist", "scans.size_mm"]
    words += ["config/patches_tiny.tsv/results: cannot be written", "7_T0.plu"]
    assert (code, absent(words, text)) == (2, [])


def test_clean_removes_what_the_study_made_and_nothing_else(tiny):
    """Asked first; a file of the user's own stays, and so does its folder."""
    mine = tiny.results / "figures/notes.txt"
    mine.write_text("of mine")
    tiny.gst("clean", tiny.config, answer="n")
    assert len(list(tiny.results.iterdir())) > 10
    tiny.gst("clean", tiny.config, answer="y")
    assert sorted(tiny.results.rglob("*")) == [mine.parent, mine]


def test_what_no_reader_needs_can_go_from_a_finished_study(tiny):
    """A run makes it again; the results that stay are not touched."""
    page, finished = tiny.results / "index.html", tiny.config

    def clean(answer):
        result = tiny.gst("clean", "--intermediate", tiny.config, answer=answer)
        return result.returncode, result.stdout + result.stderr

    def stats():
        stats = {file: file.stat() for file in tiny.results.rglob("*") if file.is_file()}
        return {file: (stat.st_size, stat.st_mtime_ns) for file, stat in stats.items()}

    before = stats()
    page.rename(page.with_suffix(".kept"))
    code, text = clean("y")
    assert (code, "index.html" in text) == (2, True)
    page.with_suffix(".kept").rename(page)
    tiny.change(wear_steps=5)
    code, text = clean("y")
    assert (code, "with another config" in text) == (2, True)
    tiny.config = finished
    assert "[y/N]" in clean("n")[1]
    assert stats() == before
    code, text = clean("y")
    after = stats()
    assert after.items() <= before.items()
    assert f"these {len(before) - len(after)} files" in text
    folders = {path.name for path in tiny.results.iterdir() if path.is_dir()}
    assert folders == {"figures", "logs", "tables"}
    assert {file for file in before if file.parent == tiny.results} < after.keys()
    assert "generate_specimen: " in tiny.gst("study", finished, "--plan").stdout


def make(target, *options, cwd=ROOT):
    """`make TARGET` with the environment under test."""
    # the tests themselves may run under make, which passes on what it was called with
    outer = {key: "" for key in os.environ if "MAKE" in key}
    program = f"BIN={Path(sys.executable).parent}"
    return run("make", "-o", ".venv/ready", program, target, *options, cwd=cwd, **outer)


@pytest.mark.parametrize("target", ["study", "sweep", "check"])
def test_a_config_that_is_no_yaml_is_refused_in_one_sentence(tmp_path, target):
    config = tmp_path / "Fläche 1" / "mine.yaml"
    config.parent.mkdir()
    config.write_text("title: my: stone\n")
    result = make(target, f"CONFIG={config}")
    assert result.returncode != 0
    assert result.stdout == ""
    error, made = result.stderr.strip().splitlines()
    assert error.startswith(f"ERROR: {config}: is not YAML in UTF-8")
    assert made.startswith("make: ***")


@pytest.mark.parametrize(
    ("folder", "is_refused"), [("Meine Steine", True), ("{a}", True), ("Müller-2.1_b+c@d", False)]
)
def test_a_project_in_a_folder_that_snakemake_cannot_use_is_refused(tmp_path, folder, is_refused):
    project = tmp_path / folder
    project.mkdir()
    for file in (ROOT / "Makefile", ROOT / "pyproject.toml", *ROOT.glob("*.lock")):
        shutil.copy(file, project)
    result = run("make", "environment", "PYTHON=false", cwd=project)  # a Python that is too old
    text = result.stdout + result.stderr
    assert ("move the project" in text) == is_refused
    assert ("is older than Python" in text) != is_refused
