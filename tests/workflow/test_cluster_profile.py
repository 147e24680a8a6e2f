"""The profile for Slurm fits the rules, as far as that can be told without a Slurm."""

import re

import yaml
from conftest import ROOT

PROFILE = ROOT / "workflow/profiles/slurm"


def test_groups_are_of_rules_that_there_are():
    text = "".join(file.read_text() for file in ROOT.glob("workflow/rules/*.smk"))
    rules = set(re.findall(r"(?:rule|checkpoint|as) (\w+)(?:| with):", text))
    rules |= set(re.findall(r'f"(\w+)\{part\}"', text))  # one for each batch of patches
    profile = yaml.safe_load((PROFILE / "config.yaml").read_text())
    assert set(profile["groups"]) | set(profile["set-threads"]) <= rules
    assert set(profile["group-components"]) <= set(profile["groups"].values())


def test_no_group_waits_for_itself(tiny):
    """Snakemake refuses such groups. What follows the checkpoint is known once that is done."""
    result = tiny.run("--workflow-profile", str(PROFILE), "--dry-run", "--forcerun", "solve_patch")
    assert result.returncode == 0, result.stderr
    planned = result.stdout + result.stderr
    for group in ("patches", "validation", "slip", "hardness", "figures"):
        assert f"Group job {group} " in planned
