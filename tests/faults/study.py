"""A study in a folder of its own, run as a user runs it (`make study`), to be ill-treated."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

ROOT = Path(__file__).parents[2]
CONFIG = "config/tiny.yaml"
RESULTS = "results-tiny"
# Neither is a result: how long a job took, and what it said.
_NO_RESULTS = {"benchmarks", "logs", "report.html"}


def project_files() -> list[str]:
    listed = ["git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard"]
    return subprocess.run(listed, capture_output=True, text=True, check=True).stdout.splitlines()


class Study:
    """A copy of the project with the tiny study in it; the environment is this one."""

    def __init__(self, folder: Path):
        self.folder, self.results = folder, folder / RESULTS

    def make_folder(self) -> "Study":
        for name in project_files():
            if (ROOT / name).is_file():
                target = self.folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, target)
        (self.folder / ".venv").symlink_to(sys.prefix)
        return self

    def copy_from(self, other: "Study") -> "Study":
        """A copy of another study, dates and Snakemake's records included."""
        shutil.copytree(other.folder, self.folder, symlinks=True)
        return self

    def start(self, target: str = "study") -> subprocess.Popen:
        """`make TARGET` in a session of its own, so that all of it can be killed at once."""
        return subprocess.Popen(
            ["make", "-o", ".venv/ready", target, f"CONFIG={CONFIG}"],
            cwd=self.folder,
            start_new_session=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )

    def make(self, target: str = "study") -> tuple[bool, str]:
        """Whether `make TARGET` ended well, and all that it said."""
        process = self.start(target)
        said = process.communicate(timeout=3600)[0]
        return process.returncode == 0, said

    def make_as_told(self) -> tuple[bool, str]:
        """`make study`, and what it says to do after a kill: `make unlock` once jobs have ended."""
        done, said = self.make()
        while not done and ("left its lock" in said or "are still at work" in said):
            if "left its lock" in said:
                unlocked, told = self.make("unlock")
                assert unlocked, told
            else:
                time.sleep(2)
            done, said = self.make()
        return done, said

    def processes(self) -> dict[str, list[psutil.Process]]:
        """The run's Snakemake (`run`) and its jobs (`job`), as they are now."""
        found = {"run": [], "job": []}
        for process in psutil.process_iter(["cwd", "cmdline"]):
            command = process.info["cmdline"] or []
            if process.info["cwd"] == str(self.folder.resolve()):
                if any("/.snakemake/scripts/" in word for word in command):
                    found["job"].append(process)
                elif any(Path(word).name == "snakemake" for word in command[:3]):
                    found["run"].append(process)
        return found

    def kill(self, process: subprocess.Popen, what: str, choose: random.Random) -> bool:
        """SIGKILL to one job, to Snakemake alone, or to the whole run; False if it has none now."""
        if what == "all":
            os.killpg(process.pid, signal.SIGKILL)
            return True
        found = self.processes()["job" if what == "job" else "run"]
        if not found:
            return False
        try:
            choose.choice(found).kill()
        except psutil.NoSuchProcess:
            return False
        return True

    def files(self) -> dict[str, bytes]:
        """Every result by its name; hidden files are none."""
        names = (file.relative_to(self.results) for file in self.results.rglob("*"))
        return {
            str(name): (self.results / name).read_bytes()
            for name in sorted(names)
            if (self.results / name).is_file()
            and name.parts[0] not in _NO_RESULTS
            and not name.name.startswith(".")
        }

    def leftovers(self) -> list[str]:
        return [str(file.relative_to(self.results)) for file in self.results.rglob("*.part")]

    def tell(self, said: str) -> None:
        """Show what a run said, where it was not what is asked of it."""
        print("\n".join("    | " + line for line in said.splitlines()[-40:]), flush=True)


def missing_or_differing(found: dict[str, bytes], reference: dict[str, bytes]) -> str:
    """What is amiss with the results of a study that has ended; empty if nothing is."""
    names = [*differing(found, reference), *(name for name in reference if name not in found)]
    return f"other results: {', '.join(names)}" if names else ""


def differing(found: dict[str, bytes], reference: dict[str, bytes]) -> list[str]:
    """Names of the results that are not, byte for byte, those of the undisturbed study."""
    return [name for name, content in found.items() if reference.get(name) != content]
