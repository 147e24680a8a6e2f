"""The other ways to run the study: the catalogue's, a container, conda. docs/how-to/install.md."""

import json
import re
import shutil
import sys
import tomllib

import pytest
import yaml
from hatchling.builders.sdist import SdistBuilder
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from .conftest import ROOT, SNAKEMAKE, Study, fresh, run

IN_A_CLONE = pytest.mark.skipif(
    not (ROOT / ".test").is_dir(), reason="the sdist leaves out .test, which holds a link"
)
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = DECLARED["project"]


def plan(*arguments, cwd, **environment):
    """A run of the whole tiny study is planned."""
    command = *SNAKEMAKE, "--dry-run", "--forceall", "--cores", "2"
    result = run(*command, *arguments, cwd=cwd, **environment)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout


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
    test_study = "--directory", ".test", "--configfile", ".test/config/tiny.yaml"
    plan("--snakefile", "workflow/Snakefile", *test_study, cwd=ROOT)
    made = [".test/results-tiny/index.html", ".test/.snakemake/log"]
    assert run("git", "check-ignore", *made, cwd=ROOT).stdout.splitlines() == made


@pytest.mark.parametrize("path", ["Snakefile", "workflow/Snakefile"])
def test_a_study_is_planned_with_all_rules_from_github(study, tmp_path, path):
    """As snakedeploy 0.17 sets it up; git is made to take a folder here for GitHub."""
    repository = tmp_path / "github/owner/gst"
    shutil.copytree(ROOT / "workflow", repository / "workflow")
    shutil.copy(ROOT / "Snakefile", repository)
    who = ("-c", "user.name=me", "-c", "user.email=me@localhost")
    for command in (["init", "--initial-branch=main"], ["add", "."], [*who, "commit", "-m", "all"]):
        run("git", *command, cwd=repository)
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
    plan("--configfile", "config/tiny.yaml", cwd=study.folder, **here)


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
    result = run(*command, cwd=study.folder, PYTHONPATH=str(folder / "src"))
    assert result.returncode == 0, result.stdout + result.stderr
    assert "score_truth" in result.stdout
    assert "steps would run." in result.stdout  # as the display says, which the profile names
    to_build = {"src", "CITATION.cff", "Makefile", "requirements-build.lock", "requirements.lock"}
    assert to_build | {PROJECT["readme"], *PROJECT["license-files"]} <= {
        file.name for file in folder.iterdir()
    }


def locked(name):
    """The versions of each package in a lock file: one, or one for each Python."""
    versions = {}
    text = (ROOT / f"{name}.lock").read_text(encoding="utf-8")
    assert "://" not in text  # the registry is the reader's own
    for package, version in re.findall(r"^([\w.-]+)==(\S+)", text, re.MULTILINE):
        versions.setdefault(package, set()).add(version)
    return versions


def test_each_lock_has_what_the_project_asks_for():
    study, checks, build = map(
        locked, ("requirements", "requirements-checks", "requirements-build")
    )
    asked = [
        (study, [*PROJECT["dependencies"], *DECLARED["build-system"]["requires"]]),
        *((study, extra) for extra in PROJECT["optional-dependencies"].values()),
        (checks, DECLARED["dependency-groups"]["checks"]),
        (build, DECLARED["dependency-groups"]["build"]),
    ]
    for lock, texts in asked:
        for requirement in map(Requirement, texts):
            name = canonicalize_name(requirement.name)
            if name != PROJECT["name"]:
                assert lock[name], name
                assert all(map(requirement.specifier.contains, lock[name])), name
    for lock in (checks, build):
        assert {name: lock[name] for name in lock.keys() & study} == {
            name: study[name] for name in lock.keys() & study
        }


def test_conda_takes_what_installs_the_locked_packages():
    python, _, by_pip = yaml.safe_load((ROOT / "environment.yaml").read_text())["dependencies"]
    assert by_pip == {"pip": ["--require-hashes", "-r requirements-build.lock"]}
    name, version = python.split(" =")
    assert name == "python"
    assert SpecifierSet(PROJECT["requires-python"]).contains(version)


def test_nothing_is_installed_without_its_hash():
    """A package of a registry by a lock; only this project without."""
    files = ROOT / "Makefile", ROOT / "Dockerfile", *ROOT.glob(".github/workflows/*")
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    assert not re.search(r"\buvx?\)? run\b|\buvx\b|--with\b", text)
    commands = re.split(r"\n|&&", text.replace("\\\n", " ").replace("$(PIP)", "pip install"))
    installing = [one for one in commands if re.search(r"pip install(?! --quiet.*isolation$)", one)]
    assert len(installing) > 5
    safe = r"--require-hashes -r |--no-deps (-e \.|dist/\*\.whl)|--constraints requirements\.lock"
    assert [one for one in installing if not re.search(safe, one)] == []


@IN_A_CLONE
def test_actions_and_the_image_stand_by_what_is_in_them():
    files = list((ROOT / ".github/workflows").iterdir())
    assert files
    for file in files:
        workflow = yaml.safe_load(file.read_text(encoding="utf-8"))
        assert workflow["permissions"] == {}
        assert all("permissions" in job for job in workflow["jobs"].values())
        for used in re.findall(r"uses: (.*)", file.read_text(encoding="utf-8")):
            assert re.fullmatch(r"[\w/-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", used)
    (image,) = re.findall(r"^FROM (.*)$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
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
    """A folder with a workflow of two tiny studies, and the config of each."""
    tiny = yaml.safe_load((study.folder / study.config).read_text())
    other = {"seed": 5, "grinding": None, "pressure_cap_MPa": None}
    other |= {
        "material": {"contact_modulus_MPa": 12820.0},
        "specimen": tiny["specimen"] | {"seed": 9},
    }
    other |= {"title": "another stone", "results": "second/results"}
    configs = {"first": tiny, "second": tiny | other}
    (study.folder / "config/both.yaml").write_text(yaml.safe_dump(configs))
    modules = [MODULE.format(name=name, snakefile=ROOT / "Snakefile") for name in configs]
    (study.folder / "Snakefile").write_text(
        'configfile: "config/both.yaml"\n' + "".join(modules) + ALL
    )
    return study.folder, configs


def made(folder, *arguments):
    result = run(*SNAKEMAKE, "--cores", "2", *arguments, cwd=folder)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout.split()


def test_rules_of_two_studies_in_one_plan(two_studies):
    """Each has its own config, and the schema's defaults of what that leaves out."""
    rules = made(two_studies[0], "--dry-run")
    assert {"first_solve_cases", "first_write_page", "second_write_page"} <= set(rules)
    assert "second_solve_cases" not in rules


@pytest.mark.slow
def test_two_studies_in_one_run_give_the_tables_of_each_alone(two_studies, finished_tiny, tmp_path):
    folder, configs = two_studies
    made(folder, "--workflow-profile", ROOT / "profiles/default")
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
