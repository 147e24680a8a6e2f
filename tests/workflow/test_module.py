"""The workflow as a module of another one: several stones in one run."""

import subprocess
import sys

import pytest
import yaml
from conftest import ROOT, Study, fresh

# What the other workflow says: nothing of this project's own folder but its Snakefile.
MODULE = """
module {name}:
    snakefile: "{snakefile}"
    config: config["{name}"]

use rule * from {name} as {name}_*
"""
ALL = """
rule all:
    default_target: True
    input: rules.first_all.input, rules.second_all.input
"""


@pytest.fixture
def two_studies(study):
    """A folder with a workflow of two tiny studies, and the config of each."""
    tiny = yaml.safe_load((study.folder / study.config).read_text())
    other = {"seed": 5, "grinding": None, "hardness": None}
    other |= {"material": {"contact_modulus_MPa": None}, "specimen": tiny["specimen"] | {"seed": 9}}
    other |= {"title": "another stone", "results": "second/results"}
    configs = {"first": tiny, "second": tiny | other}
    (study.folder / "config/both.yaml").write_text(yaml.safe_dump(configs))
    modules = [MODULE.format(name=name, snakefile=ROOT / "Snakefile") for name in configs]
    (study.folder / "Snakefile").write_text(
        'configfile: "config/both.yaml"\n' + "".join(modules) + ALL
    )
    return study.folder, configs


def run(folder, *arguments):
    command = [sys.executable, "-m", "snakemake", "--cores", "2", *arguments]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_rules_of_two_studies_in_one_plan(two_studies):
    """Each has its own config, and the schema's defaults of what that leaves out."""
    planned = run(two_studies[0], "--dry-run").split()
    assert {"first_solve_cases", "first_write_page", "second_write_page"} <= set(planned)
    assert "second_solve_cases" not in planned


@pytest.mark.slow
def test_two_studies_in_one_run_give_the_tables_of_each_alone(two_studies, finished_tiny, tmp_path):
    folder, configs = two_studies
    run(folder, "--workflow-profile", ROOT / "profiles/default")
    alone = fresh(tmp_path / "alone")
    alone.config = "config/second.yaml"
    (alone.folder / alone.config).write_text(yaml.safe_dump(configs["second"]))
    alone.succeed()
    for name, made_alone in (("first", finished_tiny), ("second", alone)):
        together = Study(folder, f"config/{name}.yaml")
        (folder / together.config).write_text(yaml.safe_dump(configs[name]))
        assert together.tables() == made_alone.tables()
        page = (together.results / "index.html").read_text().lower()
        assert configs[name]["title"].lower() in page
    assert finished_tiny.tables()["wear.csv"] != alone.tables()["wear.csv"]
