"""A study runs here as a user runs it: Snakemake in a process and a folder of its own."""

import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from filelock import FileLock
from sweep import study_of

from gst.config.reading import read_config
from gstlib.io.tables import read_table

ROOT = Path(__file__).parents[2]
# as `gst study` starts it, with this interpreter: the environment under test
SNAKEMAKE = sys.executable, "-m", "gst.run.scheduler"
GST = Path(sys.executable).with_name("gst")


def run(*command, cwd=None, **environment):
    """A command as a user gives it; how it ended, and what it printed."""
    return subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=os.environ | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


def printed(*command, code=0, **options):
    """What a command prints that ends with an exit code."""
    result = run(*command, **options)
    text = result.stdout + result.stderr
    assert result.returncode == code, text
    return text


@dataclass
class Study:
    """A folder with the shipped configs, and what Snakemake says there."""

    folder: Path
    config: str = "config/tiny.yaml"

    @property
    def results(self):
        config = yaml.safe_load((self.folder / self.config).read_text())
        return self.folder / config["results"]

    def command(self, *arguments):
        where = "--snakefile", ROOT / "Snakefile", "--directory", self.folder
        config = "--configfile", self.folder / self.config  # takes all that follows
        return [*SNAKEMAKE, *where, *arguments, *config]

    def run(self, *arguments, code=0):
        """What Snakemake prints in the folder."""
        command = self.command("--cores", "2", *arguments)
        return printed(*command, code=code, cwd=self.folder)

    def gst(self, *arguments, code=0):
        """What the command `gst` prints in the folder."""
        return printed(GST, *arguments, code=code, cwd=self.folder)

    def planned(self):
        """Names of the rules that a run would execute now."""
        plan = self.run("--dry-run")
        return {*re.findall(r"^(\w+) +\d+$", plan, re.MULTILINE)} - {"all", "total"}

    def change(self, **sections):
        """Write a config of its own: the present one with these sections or keys replaced."""
        config = yaml.safe_load((self.folder / self.config).read_text())
        for name, value in sections.items():
            is_part = isinstance(value, dict) and isinstance(config.get(name), dict)
            config[name] = config[name] | value if is_part else value
        self.config = "config/changed.yaml"
        (self.folder / self.config).write_text(yaml.safe_dump(config, sort_keys=False))

    def tables(self):
        return {
            file.name: file.read_text()
            for file in sorted(self.results.glob("tables/*.csv"))
        }

    def fields(self):
        files = sorted(self.results.rglob("*.h5"))
        return {
            str(file.relative_to(self.results)): file.read_bytes() for file in files
        }


def in_memory(study, config=None):
    """The study by the library alone, from the same files, with its own config or another."""
    return study_of(config or read_config(study.folder / study.config), study.folder)


def fresh(folder):
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copytree(ROOT / "config", folder / "config")
    return Study(folder)


@pytest.fixture
def study(tmp_path):
    """An empty folder with the shipped configs."""
    return fresh(tmp_path / "study")


@pytest.fixture(scope="session")
def finished_tiny(tmp_path_factory):
    """The tiny study, run once for all processes of the tests. Not to be changed: see `tiny`."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    done = root / "tiny/done"
    with FileLock(root / "tiny.lock"):
        if done.exists():
            return Study(root / "tiny/study")
        finished = fresh(root / "tiny/study")
        finished.run()
        done.touch()
        return finished


@pytest.fixture(scope="session")
def results(finished_tiny):
    """Of the tiny study."""
    return finished_tiny.results


@pytest.fixture(scope="session")
def table(results):
    """A table of the tiny study, by its name."""
    return lambda name: read_table(results / f"tables/{name}.csv")


@pytest.fixture(scope="session")
def config(finished_tiny):
    """What the tiny study was asked for, with all that its config leaves out."""
    return read_config(finished_tiny.folder / finished_tiny.config)


@pytest.fixture
def tiny(finished_tiny, tmp_path):
    """A copy of the finished tiny study, dates and Snakemake's records included."""
    folder = tmp_path / "study"
    shutil.copytree(finished_tiny.folder, folder, copy_function=shutil.copy2)
    return Study(folder)


@pytest.fixture(scope="module")
def browser():
    """Chromium, with WebGL that needs no graphics card."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="needs `make test-browser`"
    )
    names = ("chromium", "chromium-browser", "google-chrome")
    if (program := next(filter(None, map(shutil.which, names)), None)) is None:
        pytest.skip("needs Chromium on the PATH")
    software = (
        "--disable-gpu",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    )
    options = ("--no-sandbox", "--disable-background-networking", *software)
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=options)
        yield browser
        browser.close()


def listened_to(page):
    """What a page asks for, and what it complains of, from now on."""
    asked, complaints = [], []

    def hear(message):
        if message.type == "error":
            complaints.append(message.text)

    page.on("request", lambda request: asked.append(request.url))
    page.on("console", hear)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    return asked, complaints


def middle_of(thing):
    """Where the middle of a thing on a page is, from the left and from the top."""
    box = thing.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


# Texts whose contrast is less than WCAG's 4.5 to 1, and controls without a name.
UNREADABLE = """() => {
  const numbers = (text) => text.match(/[0-9.]+/g).map(Number);
  const light = (rgb) => [0.2126, 0.7152, 0.0722].reduce((sum, share, k) => {
    const value = rgb[k] / 255;
    return sum + share * (value <= 0.04 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
  }, 0);
  const seen = (each) => each.checkVisibility({ opacityProperty: true })
    && !each.disabled && !each.closest("[inert]");
  const ground = (each) => {
    const rgba = numbers(getComputedStyle(each).backgroundColor);
    return rgba[3] === 0 && each.parentElement ? ground(each.parentElement) : rgba;
  };
  const isPale = (each) => {
    const [a, b] = [numbers(getComputedStyle(each).color), ground(each)].map(light);
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5;
  };
  const isText = (node) => node.nodeType === 3 && node.data.trim();
  const hasText = (each) => [...each.childNodes].some(isText);
  const name = (each) => each.ariaLabel || (each.labels?.[0] || each).textContent.trim();
  const everything = [...document.querySelectorAll("body *:not(svg *)")].filter(seen);
  return [
    ...everything.filter((each) => hasText(each) && isPale(each)),
    ...everything.filter((each) => each.matches("input, select, button") && !name(each)),
  ].map((each) => each.outerHTML);
}"""


@contextmanager
def opened(browser, address, size=(1366, 768), complaints=()):
    """A page with a stone. It asks for nothing but what lies under its address.

    It complains of nothing, except what is part of `complaints`.
    """
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(0)  # a busy machine is no fault
    asked, complained = listened_to(page)
    try:
        page.goto(address)
        page.wait_for_selector("canvas", state="attached")
        own = address, page.url.partition("#")[0], "data:"
        yield page
    finally:
        page.close()
    assert [url for url in asked if not url.startswith(own)] == []
    assert [
        line for line in complained if not any(part in line for part in complaints)
    ] == []


def as_measured(study, finished):
    """The specimen's files of a finished study, given as a user gives measured ones."""
    shutil.copytree(finished.results / "specimen", study.folder / "data")
    files = {"mesh": "data/mesh.stl", "mesh_unit": "mm", "scan_folder": "data/scans"}
    study.change(results="results-measured", specimen=None, inputs=files)
    return study


@pytest.fixture
def measured(study, finished_tiny):
    return as_measured(study, finished_tiny)
