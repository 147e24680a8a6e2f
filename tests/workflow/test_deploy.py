"""The other ways to run the study: the catalogue's, a container, conda. docs/how-to/install.md."""

import json
import re
import sys
import tomllib

import pytest
import yaml

from .conftest import ROOT, SNAKEMAKE, printed

IN_A_CLONE = pytest.mark.skipif(
    not (ROOT / ".test").is_dir(),
    reason="the sdist leaves out .test, which holds a link",
)
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = DECLARED["project"]


def test_the_container_has_all_that_a_study_needs(study, tmp_path):
    """What the recipe copies, and what it starts."""
    recipe = (ROOT / "Dockerfile").read_text("utf-8")
    assert json.loads(re.search(r"^ENTRYPOINT (.*)$", recipe, re.MULTILINE)[1]) == [
        "gst"
    ]
    folder = tmp_path / "image"
    folder.mkdir()
    for names in re.findall(r"^COPY (.*) \S+$", recipe, re.MULTILINE):
        printed("cp", "-r", *names.split(), folder, cwd=ROOT)
    assert {PROJECT["readme"], *PROJECT["license-files"]} <= {
        file.name for file in folder.iterdir()
    }
    command = "study", "--plan", study.folder / study.config
    text = printed(
        *(sys.executable, "-m", "gst", *command),
        cwd=study.folder,
        PYTHONPATH=str(folder / "src"),
    )
    assert "score_truth" in text
    assert "steps would run." in text  # as the display says, which the profile names


def test_nothing_is_installed_without_its_hash():
    """A package of a registry by a lock; only this project without."""
    files = ROOT / "Makefile", ROOT / "Dockerfile", *ROOT.glob(".github/workflows/*")
    text = "\n".join(file.read_text("utf-8") for file in files)
    assert not re.search(r"\buvx?\)? run\b|\buvx\b|--with\b", text)
    commands = re.split(
        r"\n|&&", text.replace("\\\n", " ").replace("$(PIP)", "pip install")
    )
    installing = [
        one
        for one in commands
        if re.search(r"pip install(?! --quiet.*isolation$)", one)
    ]
    assert len(installing) > 5
    safe = r"--require-hashes -r |--no-deps (-e \.|dist/\*\.whl)|--constraints requirements\.lock"
    assert [one for one in installing if not re.search(safe, one)] == []


@IN_A_CLONE
def test_actions_and_the_image_stand_by_what_is_in_them():
    for file in (ROOT / ".github/workflows").iterdir():
        text = file.read_text("utf-8")
        assert yaml.safe_load(text)["permissions"] == {}
        for used in re.findall(r"uses: (.*)", text):
            assert re.fullmatch(r"[\w/-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", used)
    (image,) = re.findall(
        r"^FROM (.*)$", (ROOT / "Dockerfile").read_text(), re.MULTILINE
    )
    assert re.fullmatch(r"debian:[\w-]+@sha256:[0-9a-f]{64}", image)


# --- As a module of another workflow ---------------------------------------------------------


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
    """A folder with a workflow of two tiny studies, each with a config of its own."""
    tiny = yaml.safe_load((study.folder / study.config).read_text())
    other = {
        "title": "another stone",
        "results": "second/results",
        "grinding": None,
        "pressure_cap_MPa": None,
        "specimen": tiny["specimen"] | {"seed": 9},
    }
    configs = {"first": tiny, "second": tiny | other}
    (study.folder / "config/both.yaml").write_text(yaml.safe_dump(configs))
    modules = [
        MODULE.format(name=name, snakefile=ROOT / "Snakefile") for name in configs
    ]
    text = "".join(['configfile: "config/both.yaml"\n', *modules, ALL])
    (study.folder / "Snakefile").write_text(text)
    return study.folder


def test_rules_of_two_studies_in_one_plan(two_studies):
    """Each has its own config, and the schema's defaults of what that leaves out."""
    command = *SNAKEMAKE, "--cores", "2", "--dry-run"
    rules = set(printed(*command, cwd=two_studies).split())
    assert {"first_solve_cases", "first_write_page", "second_write_page"} <= rules
    assert "second_solve_cases" not in rules
