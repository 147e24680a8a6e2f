"""The other ways to run the study: the catalogue's, a container, conda. docs/deploy.md."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
import yaml
from conftest import ROOT
from hatchling.builders.sdist import SdistBuilder
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

TEST_STUDY = ["--directory", ".test", "--configfile", ".test/config/tiny.yaml"]
IN_A_CLONE = pytest.mark.skipif(
    not (ROOT / ".test").is_dir(), reason="the sdist leaves out .test, which holds a link"
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def plan(*arguments, cwd, **environment):
    """What a run of the whole tiny study would do."""
    command = [sys.executable, "-m", "snakemake", "--dry-run", "--forceall", "--cores", "2"]
    return subprocess.run(
        [*command, *arguments],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@IN_A_CLONE
def test_the_catalogue_is_told_what_holds():
    file = ROOT / ".snakemake-workflow-catalog.yml"
    usage = yaml.safe_load(file.read_text(encoding="utf-8"))["usage"]
    rules = "".join(file.read_text() for file in ROOT.glob("workflow/rules/*.smk"))
    by_conda, by_container = (f"{word}:" in rules for word in ("conda", "container"))
    assert usage["software-stack-deployment"] == {
        "conda": by_conda,
        "apptainer": by_container,
        "apptainer+conda": by_conda and by_container,
    }
    assert usage["report"] == ("report(" in rules)
    assert (ROOT / "config/README.md").is_file()
    # beside a folder `workflow`, it looks for a Snakefile nowhere else
    result = plan("--snakefile", "workflow/Snakefile", *TEST_STUDY, cwd=ROOT)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout


@pytest.mark.parametrize("path", ["Snakefile", "workflow/Snakefile"])
def test_a_study_is_planned_with_all_rules_from_github(study, tmp_path, path):
    """As snakedeploy 0.17 sets it up; git is made to take a folder here for GitHub."""
    repository = tmp_path / "github/owner/gst"
    shutil.copytree(ROOT / "workflow", repository / "workflow")
    shutil.copy(ROOT / "Snakefile", repository)
    who = ("-c", "user.name=me", "-c", "user.email=me@localhost")
    for command in (["init", "--initial-branch=main"], ["add", "."], [*who, "commit", "-m", "all"]):
        subprocess.run(["git", *command], cwd=repository, check=True, capture_output=True)
    (study.folder / "workflow").mkdir()
    (study.folder / "workflow/Snakefile").write_text(
        'configfile: "config/config.yaml"\n'
        "module gst:\n"
        f'    snakefile: github("owner/gst", path="{path}", branch="main")\n'
        "    config: config\n"
        "use rule * from gst\n"
    )
    here = {"GIT_CONFIG_COUNT": "1", "GIT_CONFIG_KEY_0": f"url.{tmp_path}/github/.insteadOf"}
    here |= {"GIT_CONFIG_VALUE_0": "https://github.com/", "XDG_CACHE_HOME": f"{tmp_path}/cache"}
    result = plan("--configfile", "config/tiny.yaml", cwd=study.folder, **here)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout


@IN_A_CLONE
def test_the_test_study_is_planned_in_a_folder_of_its_own():
    result = plan(*TEST_STUDY, cwd=ROOT)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout
    made = ["git", "check-ignore", ".test/results-tiny/index.html", ".test/.snakemake/log"]
    ignored = subprocess.run(made, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ignored.stdout.splitlines() == made[2:]


def test_the_sdist_has_the_tables_that_its_tests_read():
    packed = {file.distribution_path for file in SdistBuilder(str(ROOT)).recurse_included_files()}
    for folder in ("benchmarks/results", "tests/baseline/tables"):
        tables = {f"{folder}/{file.name}" for file in (ROOT / folder).glob("*.csv")}
        assert tables
        assert tables <= packed


@pytest.fixture
def image(tmp_path):
    """The folder of an image, with what the recipe copies into it; and what it starts."""
    recipe = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    for names in re.findall(r"^COPY (.*)$", recipe, re.MULTILINE):
        *sources, target = names.split()
        for name in sources:
            to = tmp_path / "image" / (name if target == "./" else target)
            to.parent.mkdir(exist_ok=True)
            (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, to)
    (entry,) = re.findall(r"^ENTRYPOINT (.*)$", recipe, re.MULTILINE)
    return tmp_path / "image", json.loads(entry)


def test_the_container_has_all_that_a_study_needs(image, study):
    folder, entry = image
    assert entry == ["gst"]
    command = [sys.executable, "-m", "gst", "study", "--plan", f"{study.folder}/config/tiny.yaml"]
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    result = subprocess.run(
        command, cwd=study.folder, env=environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout
    assert "profiles/default" in result.stderr
    to_build = {
        "src",
        PROJECT["readme"],
        *PROJECT["license-files"],
        "CITATION.cff",
        "Makefile",
        "requirements.lock",
    }
    assert to_build <= {file.name for file in folder.iterdir()}


def test_conda_takes_the_locked_packages_under_a_python_that_they_are_for():
    python, _, by_pip = yaml.safe_load((ROOT / "environment.yaml").read_text())["dependencies"]
    assert by_pip == {"pip": ["--require-hashes", "-r requirements.lock"]}
    name, version = python.split(" =")
    assert name == "python"
    assert SpecifierSet(PROJECT["requires-python"]).contains(version)
    locked = set(
        re.findall(r"^([\w.-]+)==", (ROOT / "requirements.lock").read_text(), re.MULTILINE)
    )
    extras = PROJECT["optional-dependencies"]
    needed = PROJECT["dependencies"] + [
        of for name in ("fast", "formats", "texture", "workflow") for of in extras[name]
    ]
    assert {Requirement(text).name.lower() for text in needed} - {"gstlib"} <= locked
