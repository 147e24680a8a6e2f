"""Bad input: all problems at once, in clear errors, by `make check` and before a run begins."""

import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of
from numpy.polynomial.legendre import legvander2d

from .conftest import ROOT, as_measured, in_memory, run


def check(study):
    """`gst check`: its exit code, and what it said."""
    result = study.gst("check", study.config)
    return result.returncode, result.stdout + result.stderr


def missing(said, *words):
    """The words that were not said, and a traceback that was."""
    return [w for w in words if w not in said] + ["Traceback"] * ("Traceback" in said)


def test_good_files(measured):
    measured.change(load={"force_N": 550.0, "at_mm": [3.2, 2.0]})
    code, said = check(measured)
    assert code == 0, said
    assert "force through x 3.2, y 2 mm" in said
    plane = in_memory(measured).contact.interface.plane
    # of the mesh alone
    (tilt,) = map(float, re.findall(r"tilted by ([\d.]+) mrad", said))
    assert tilt == pytest.approx(1e3 * np.hypot(plane.slope_y, plane.slope_x), rel=0.2)
    words = ("E* = 10346 MPa, from the elastic constants", "No problems found, but 1 note")
    facts = ("up to 64 × 64 points; Sq ", " mm along its x, y, z; mean edge length ")
    assert missing(said, *words, *facts) == []
    assert said.count("NOTE") == 1  # the mesh is too coarse to check the heights' unit
    names = {file.name for file in measured.results.iterdir()}
    assert names == {"check.png", ".gst_outputs"}


def test_a_load_that_nothing_can_hold_is_told(measured):
    measured.change(load={"force_N": 550.0, "at_mm": [0.05, 0.05]}, macroscale={"face_mm": 5.0})
    code, said = check(measured)
    assert code == 2
    assert missing(said, "the stone tips over", "x 0.05, y 0.05 mm", "load.at_mm") == []
    measured.change(load={"at_mm": [1.0, 1.0]})
    code, said = check(measured)
    assert (code, missing(said, "of the edge of what is pressed", "1 warning")) == (0, [])


def test_a_load_that_no_patch_bears_is_told(measured):
    for force_N, is_told in ((0.1, True), (550.0, False)):
        load = {"force_N": force_N, "at_mm": [0.6, 4.4]}
        measured.change(load=load, counterface={"radius_mm": 20.0})
        code, said = check(measured)
        assert (code, "no patch is touched" in said) == (0, is_told), said


def test_every_problem_of_a_config(study):
    study.change(macroscale={"grid": -4, "steppes": 3}, material={"poisson_1": 0.7})
    words = ("macroscale.grid", "-4", "steppes", "remove or correct", "material.poisson_1", "0.7")
    result = study.run("--dry-run")
    for code, said in (check(study), (result.returncode, result.stdout + result.stderr)):
        assert code > 0
        assert missing(said, "changed.yaml", *words, "config/README.md") == []


def test_a_flip_that_is_wrong_is_named(study):
    """By the check and by the step, where the mesh is fine enough to show the patches' waves."""
    fine = {"mesh_edge_mm": 0.3, "cut_off_wavelength_mm": 0.6}
    study.change(specimen=fine, scans={"mould": {"flip": "x"}})
    study.succeed("results-tiny/specimen/mesh.stl")
    as_measured(study, study)
    for flip in ("x", None, "y"):
        study.change(scans={"mould": {"flip": flip}})
        code, said = check(study)
        assert ("et scans.mould.flip to x" in said) == (code == 2) == (flip != "x")
    table = "results-measured/tables/placement.csv"
    result = study.run(table)
    assert result.returncode
    assert "accept: [placement]" in result.stderr
    study.change(accept=["placement"])
    assert "ACCEPTED FAULT: patches: they fit the mesh turned" in study.succeed(table)
    assert "1 accepted fault" in check(study)[1]
    # it has one cure
    study.change(accept=[])
    assert study.gst("check", study.config, "--fix", said="y\n").returncode == 0
    assert check(study)[0] == 0
    assert (study.folder / f"{study.config}.bak").exists()


def exchange(folder, one, other):
    """Two scans."""
    first, second = ((folder / f"data/scans/{name}.plu") for name in (one, other))
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def test_scans_of_other_patches_and_epochs_are_told(measured):
    """T0 and T1 of two patches are exchanged, and T1 of two others."""
    exchange(measured.folder, "5_T0", "5_T1")
    exchange(measured.folder, "7_T0", "7_T1")
    code, said = check(measured)
    assert code == 0
    assert missing(said, "patches 5, 7: more rose than fell", "t0 and t1 exchanged") == []
    exchange(measured.folder, "10_T1", "11_T1")
    code, said = check(measured)
    assert code == 2
    # T1 of patch 10 shows less than a third of it, so it may lie between two patches
    words = "10_T1.plu: as T1 of patch 10", "but on T0 of patch 11", "11_T1.plu: patch 11"
    assert missing(said, *words) == []


def test_a_form_that_was_taken_out_of_one_epoch_is_told(measured):
    """Whether T1 is still found on T0 or not."""
    for name in ("5_T1", "7_T1"):
        heights = read_scan(measured.folder / f"data/scans/{name}.plu")
        y, x = (np.linspace(-1, 1, n) for n in heights.shape)
        at = (each.ravel() for each in np.meshgrid(y, x, indexing="ij"))
        known, powers = np.isfinite(heights.values).ravel(), legvander2d(*at, [8, 8])
        factors = np.linalg.lstsq(powers[known], heights.values.ravel()[known], rcond=None)[0]
        level = heights.values - (powers @ factors).reshape(heights.shape)
        write_plu(measured.folder / f"data/scans/{name}.plu", level, spacing_of(heights)[1])
    code, said = check(measured)
    assert code == 0
    assert said.count("a form had been taken out of T1 alone") == 2
    assert "not found on T0" not in said


def test_a_repeat_that_shows_a_change_is_told(measured):
    """As the study itself would, hours later; one that shows none is no cause for doubt."""
    scans, noise = measured.folder / "data/scans", np.random.default_rng(1)
    for patch, moved_mm in (("5", 0.0), ("13", 0.004)):
        heights = read_scan(scans / f"{patch}_T0.plu")
        heights[10:30, 10:40] += moved_mm
        again = heights.values + 2e-5 * noise.standard_normal(heights.shape)
        write_plu(scans / f"{patch}_repeat.plu", again, spacing_of(heights)[1])
    table = measured.folder / "config/patches_tiny.tsv"
    rows = table.read_text().replace("t0\tt1", "t0\tt1\trepeat")
    rows = re.sub(r"T1.plu$", "T1.plu\t", rows, flags=re.MULTILINE)
    table.write_text(re.sub(r"(\b(?:5|13)_)T1.plu\t", r"\1T1.plu\t\1repeat.plu", rows))
    code, said = check(measured)
    assert code == 0
    assert "patch 13: its repeat is not used" in said
    assert "patch 5: its repeat" not in said


def test_scans_that_other_software_laid_on_each_other_are_told(measured):
    """As ConfoMap saves them: cut from one grid, worn in between; here as text without a unit."""
    scans = measured.folder / "data/scans"
    noise = np.random.default_rng(1)
    for file in sorted(scans.glob("*_T0.plu")):
        before = read_scan(file)
        lowest = np.nanquantile(before, 0.1)  # of a mould: the highest of the stone
        worn = before.clip(min=lowest) + 1e-5 * noise.standard_normal(before.shape)
        for epoch, heights in (("T0", before), ("T1", worn)):
            stem = scans / file.stem.replace("T0", epoch)
            stem.with_suffix(".plu").unlink()
            np.savetxt(stem.with_suffix(".csv"), heights * 1e3, delimiter=",")
    table = measured.folder / "config/patches_tiny.tsv"
    table.write_text(re.sub(r"\t[^\t]*\t[^\t]*$", "", table.read_text(), flags=re.MULTILINE))
    measured.change(scans={"unit": "um", "spacing_um": 13.28})
    code, said = check(measured)
    assert code == 0
    found = r"T1 on T0 +found on 6 patches, shifted by up to ([\d.]+) µm; all co-"
    (off,) = re.findall(found, said)
    assert float(off) < 0.05
    assert said.count("NOTE") == 1  # the mesh is too coarse to check the heights' unit


def test_everything_wrong_with_the_files_is_reported_at_once(measured):
    """By the check, and by the first step of a run, which leaves nothing half made."""
    data = measured.folder / "data"
    for name in ("7_T0.plu", "7_T1.plu"):
        (data / "scans" / name).write_bytes((data / "scans" / name).read_bytes()[:3000])
    heights = read_scan(data / "scans/5_T0.plu")
    heights[: len(heights) // 2] = np.nan
    write_plu(data / "scans/5_T0.plu", heights.values, spacing_of(heights)[1])
    for file in data.glob("scans/13_T?.plu"):  # the whole square needs one grid
        heights = read_scan(file)
        write_plu(file, heights.values[::2, ::2], 2 * spacing_of(heights)[1])
    mesh = data / "mesh.stl"
    trimesh.load_mesh(mesh).apply_scale(1e-3).export(mesh)
    measured.change(interlayer={"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 9.0})
    words = (
        "5 problems",
        "interlayer.thickness_um",
        "reference_draws",
        "maximum_unmeasured",
        "mesh_unit",
    )
    words += "truncated", "data/mesh.stl", "7_T0.plu", "7_T1.plu", "5_T0.plu", "13_T0.plu"
    result = measured.run()
    for code, said in (check(measured), (result.returncode, result.stdout + result.stderr)):
        assert code > 0
        assert missing(said, *words) == []
    assert not [file for file in measured.results.rglob("*") if file.suffix in (".h5", ".csv")]


def test_files_that_are_missing_do_not_hide_faults_of_the_others(measured):
    (measured.folder / "data/mesh.stl").unlink()
    (measured.folder / "data/scans/5_T1.plu").unlink()
    measured.change(scans={"size_mm": 0.5}, results="config/patches_tiny.tsv/results")
    code, said = check(measured)
    assert code == 2
    words = ("mesh: data/mesh.stl does not exist", "5_T1.plu does not exist", "correct their names")
    words += ("config/patches_tiny.tsv/results: cannot be written",)
    assert missing(said, *words, "7_T0.plu", "0.8499", "0.5 × 0.5 mm", "scans.size_mm") == []
    table = measured.folder / "config/patches_tiny.tsv"
    table.write_text(table.read_text().replace("\t0.50\t", "\t0.10\t", 1))
    result = measured.run("--dry-run")
    for code, said in (check(measured), (result.returncode, result.stdout + result.stderr)):
        assert code > 0
        assert missing(said, "patches_tiny.tsv", "patch 5", "sticks out", "mm") == []


def test_clean_removes_what_the_study_made_and_nothing_else(tiny):
    """Asked first; a file of the user's own stays, and so does its folder."""
    mine = tiny.results / "figures/notes.txt"
    mine.write_text("of mine")
    tiny.gst("clean", tiny.config, said="n")
    assert len(list(tiny.results.iterdir())) > 10
    tiny.gst("clean", tiny.config, said="y")
    assert sorted(tiny.results.rglob("*")) == [mine.parent, mine]


def test_what_no_reader_needs_can_go_from_a_finished_study(tiny):
    """A run makes it again; the results that stay are not touched."""
    page, clean = tiny.results / "index.html", ("clean", "--intermediate", tiny.config)
    content = page.read_bytes()
    page.unlink()
    refused = tiny.gst(*clean, said="y")
    assert (refused.returncode, "index.html" in refused.stderr) == (2, True)
    page.write_bytes(content)
    given = tiny.config
    tiny.change(wear_steps=5)
    refused = tiny.gst(*clean[:-1], tiny.config, said="y")
    assert (refused.returncode, "with another config" in refused.stderr) == (2, True)
    tiny.config = given

    def sizes():
        stats = {file: file.stat() for file in tiny.results.rglob("*") if file.is_file()}
        return {file: (stat.st_size, stat.st_mtime_ns) for file, stat in stats.items()}

    before = sizes()
    assert "[y/N]" in tiny.gst(*clean, said="n").stdout
    assert sizes().keys() == before.keys()
    said = tiny.gst(*clean, said="y").stdout
    after = sizes()
    assert after.items() <= before.items()
    assert {path.name for path in tiny.results.iterdir() if path.is_dir()} == {
        "figures",
        "logs",
        "tables",
    }
    assert {file for file in before if file.parent == tiny.results} < after.keys()
    count, freed = map(float, re.findall(r"these (\d+) files \(([\d.]+) MB\)", said)[0])
    size, left = (1e-6 * sum(size for size, _ in of.values()) for of in (before, after))
    assert (count, freed) == pytest.approx((len(before) - len(after), size - left), abs=0.1)
    assert "generate_specimen: " in tiny.gst("study", tiny.config, "--plan").stdout
    assert "is missing" in tiny.gst("check", tiny.config).stdout
    assert "no intermediate results" in tiny.gst(*clean, said="y").stdout


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
    assert error.startswith(f"ERROR: {config}: is not YAML in UTF-8: mapping values")
    assert made.startswith("make: ***")


@pytest.mark.parametrize(
    ("folder", "refused"), [("Meine Steine", True), ("{a}", True), ("Müller-2.1_b+c@d", False)]
)
def test_a_project_in_a_folder_that_snakemake_cannot_use_is_refused(tmp_path, folder, refused):
    project = tmp_path / folder
    project.mkdir()
    for file in (ROOT / "Makefile", ROOT / "pyproject.toml", *ROOT.glob("*.lock")):
        shutil.copy(file, project)
    result = run("make", "environment", "PYTHON=false", cwd=project)  # a Python that is too old
    assert ("move the project" in result.stdout + result.stderr) == refused
    assert ("is older than Python" in result.stdout + result.stderr) != refused
