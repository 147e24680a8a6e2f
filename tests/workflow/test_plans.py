"""Every shipped config and the profile for Slurm plan a whole study, and the linter is content."""

import re

import pytest
import yaml

from gst.config.patches import read_patches

from .conftest import ROOT, SNAKEMAKE, printed, run

# config/tiny.yaml is planned by other tests.
CONFIGS = [
    "artefact.yaml",
    "m12.yaml",
    "mesh_only.yaml",
    "interlayer.yaml",
    "own.yaml",
    "pebble.yaml",
    "two_tools.yaml",
]
# One environment with a locked set of packages serves the whole workflow (see the Makefile): an
# environment for each rule would install the same packages again.
CHOSEN = "* Specify a conda environment or container for each rule.:"
SLURM = ROOT / "profiles/slurm"


@pytest.mark.parametrize("name", CONFIGS)
def test_a_shipped_config_plans_a_study(study, name):
    study.config = f"config/{name}"
    config = yaml.safe_load((study.folder / study.config).read_text())
    if inputs := config.get("inputs"):
        files = [inputs["mesh"]]
        if config.get("patches"):
            path = study.folder / config["patches"]
            patches = read_patches(path, size_mm=5.0, patch_size_mm=0.85)
            scans = {*patches.t0, *patches.t1} - {""}
            files += [f"{inputs['scan_folder']}/{scan}" for scan in scans]
        for file in files:
            (study.folder / file).parent.mkdir(parents=True, exist_ok=True)
            (study.folder / file).touch()  # a plan looks only at their presence
    if name == "own.yaml":  # its user gives the square
        refused = study.run("--dry-run", code=1)
        assert "'square.points_mm' is still TODO" in refused
        study.change(square={"points_mm": [[0, 0, 0], [5, 0, 0], [0, 5, 0]]})
    planned = study.planned()
    assert planned > {
        "check_inputs",
        "grid_macroscale",
        "solve_macroscale",
        "write_page",
    }
    has_scans = name not in ("artefact.yaml", "mesh_only.yaml")
    for rule in ("couple_scales", "solve_patches", "draw_contact"):
        assert (rule in planned) == has_scans
    assert has_scans or ("infer_use" in planned) == (name == "artefact.yaml")


def test_without_a_config_that_of_the_folder_is_taken(study):
    """Its values are those that `gst` reads."""
    text = "results: elsewhere\npressure_cap_MPa: 1e3\n"  # which is text in YAML 1.1
    (study.folder / "config/config.yaml").write_text(text)
    command = *SNAKEMAKE, "--snakefile", ROOT / "Snakefile", "--dry-run"
    plan = printed(*command, cwd=study.folder)
    assert "elsewhere/specimen/scans/25_T0.plu" in plan


def test_gst_plans_without_making_anything(study):
    text = study.gst("study", study.config, "--plan", "grid_macroscale")
    assert "3 steps would run." in text
    assert "profile" not in text
    assert not study.results.exists()


def test_slurm_groups_are_of_rules_that_there_are_and_do_not_wait_for_themselves(study):
    """Snakemake refuses groups that wait for themselves."""
    text = study.run("--workflow-profile", SLURM, "--dry-run")
    profile = yaml.safe_load((SLURM / "config.yaml").read_text())
    rules = "".join(file.read_text() for file in ROOT.glob("workflow/rules/*.smk"))
    assert set(profile["groups"]) <= set(
        re.findall(r"^ *rule (\w+):", rules, re.MULTILINE)
    )
    assert set(profile["group-components"]) <= set(profile["groups"].values())
    planned = set(re.findall(r"^(\w+) +\d+$", text, re.MULTILINE))
    for group in {
        group for rule, group in profile["groups"].items() if rule in planned
    }:
        assert f"Group job {group} " in text


def test_lint():
    result = run(*SNAKEMAKE, "--snakefile", ROOT / "Snakefile", "--lint", cwd=ROOT)
    lints = {
        line.strip() for line in result.stderr.splitlines() if line.startswith("    * ")
    }
    assert lints == {CHOSEN}  # so the linter ran, and its words are as we know them
