"""A study runs here as a user runs it: Snakemake in a process and a folder of its own."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml
from filelock import FileLock

ROOT = Path(__file__).parents[2]


@dataclass
class Study:
    """A folder with the shipped configs, and what Snakemake says there."""

    folder: Path
    config: str = "config/tiny.yaml"
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def results(self) -> Path:
        return self.folder / yaml.safe_load((self.folder / self.config).read_text())["results"]

    def command(self, *arguments: str, cores: int = 2) -> list[str]:
        # -m with this interpreter: the environment under test, whatever is on the PATH
        return [
            sys.executable,
            "-m",
            "snakemake",
            "--snakefile",
            str(ROOT / "Snakefile"),
            "--directory",
            str(self.folder),
            "--cores",
            str(cores),
            *arguments,
            "--configfile",
            str(self.folder / self.config),  # takes all that follows
        ]

    def run(self, *arguments: str, cores: int = 2) -> subprocess.CompletedProcess:
        return subprocess.run(
            self.command(*arguments, cores=cores),
            cwd=self.folder,
            env=os.environ | self.environment,
            capture_output=True,
            text=True,
            check=False,
        )

    def gst(self, *arguments: str, said: str = "") -> subprocess.CompletedProcess:
        """The command `gst` in the folder, answered with `said`."""
        return subprocess.run(
            [Path(sys.executable).with_name("gst"), *arguments],
            cwd=self.folder,
            input=said,
            capture_output=True,
            text=True,
            check=False,
        )

    def succeed(self, *arguments: str, cores: int = 2) -> str:
        """Run, and give what was said."""
        result = self.run(*arguments, cores=cores)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout + result.stderr

    def planned(self, *arguments: str) -> set[str]:
        """Names of the rules that a run would execute now."""
        counts = re.findall(r"^(\w+) +\d+$", self.succeed("--dry-run", *arguments), re.MULTILINE)
        return set(counts) - {"all", "total"}

    def change(self, **sections: object) -> None:
        """Write a config of its own: the present one with these sections or keys replaced."""
        config = yaml.safe_load((self.folder / self.config).read_text())
        for name, value in sections.items():
            if isinstance(value, dict) and isinstance(config.get(name), dict):
                config[name] |= value
            else:
                config[name] = value
        self.config = "config/changed.yaml"
        (self.folder / self.config).write_text(yaml.safe_dump(config, sort_keys=False))

    def tables(self) -> dict[str, str]:
        return {file.name: file.read_text() for file in sorted(self.results.glob("tables/*.csv"))}


def fresh(folder: Path) -> Study:
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copytree(ROOT / "config", folder / "config")
    return Study(folder)


@pytest.fixture
def study(tmp_path) -> Study:
    """An empty folder with the shipped configs."""
    return fresh(tmp_path / "study")


@pytest.fixture(scope="session")
def finished_tiny(tmp_path_factory) -> Study:
    """The tiny study, run once for all processes of the tests. Not to be changed: see `tiny`."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    done = root / "tiny/done"
    with FileLock(root / "tiny.lock"):
        if done.exists():
            return Study(root / "tiny/study")
        finished = fresh(root / "tiny/study")
        finished.succeed()
        done.touch()
        return finished


@pytest.fixture
def tiny(finished_tiny, tmp_path) -> Study:
    """A copy of the finished tiny study, dates and Snakemake's records included."""
    folder = tmp_path / "study"
    shutil.copytree(finished_tiny.folder, folder, copy_function=shutil.copy2)
    return Study(folder)


@pytest.fixture(scope="module")
def browser():
    """Chromium, with WebGL that needs no graphics card."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs `make test-browser`")
    names = ("chromium", "chromium-browser", "google-chrome")
    if (program := next(filter(None, map(shutil.which, names)), None)) is None:
        pytest.skip("needs Chromium on the PATH")
    software = ("--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    options = ("--no-sandbox", "--disable-background-networking", *software)
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=options)
        yield browser
        browser.close()


@pytest.fixture
def measured(study, finished_tiny):
    """The tiny specimen's files, given as a user gives measured ones."""
    shutil.copytree(finished_tiny.results / "specimen", study.folder / "data")
    study.change(
        results="results-measured",
        specimen=None,
        inputs={"mesh": "data/mesh.stl", "mesh_unit": "mm", "scan_folder": "data/scans"},
    )
    return study
