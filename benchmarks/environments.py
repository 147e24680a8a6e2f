"""One environment for each peer, made on first use from a pinned list in requirements/."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).parent
FOLDER = HERE / ".environments"


class UnavailableError(Exception):
    """A code that cannot be run here; the message says why in one line."""


@dataclass(frozen=True)
class Environment:
    """A code's own interpreter.

    `requirements` names the list in requirements/; with `build`, a second list is installed first
    and the code is compiled against it. `python` is the version of the interpreter, by default
    this one's. `settings` go to the build.
    """

    name: str
    module: str
    requirements: str = ""
    build: bool = False
    python: str = ""
    settings: dict = field(default_factory=dict)

    def interpreter(self):
        """The environment's python, made if it is not there.

        Raises
        ------
        UnavailableError
        """
        if not self.requirements:
            return Path(sys.executable)
        folder = FOLDER / self.name
        wanted = self._list().read_text(encoding="utf-8")
        stamp = folder / "installed.txt"
        python = folder / "bin" / "python"
        if stamp.exists() and stamp.read_text(encoding="utf-8") == wanted:
            return python
        print(f"making the environment of {self.name} ...", flush=True)
        uv = _uv()
        _run(uv, "venv", "--quiet", "--clear", "--python", self._base(uv), folder)
        install = (uv, "pip", "install", "--quiet", "--no-deps", "--python", python)
        if self.build:
            _run(*install, "-r", self._list(".build"))
            # One compiler at a time: its memory, and the other work on the machine.
            settings = {"CMAKE_BUILD_PARALLEL_LEVEL": "1", **self.settings}
            options = (
                "--no-build-isolation",
                *(("--no-cache",) if self.settings else ()),
            )
            _run(*install, *options, "-r", self._list(), **settings)
        else:
            _run(*install, "-r", self._list())
        _run(python, "-c", f"import {self.module}")
        stamp.write_text(wanted, encoding="utf-8")
        return python

    def _list(self, suffix=""):
        return HERE / "requirements" / f"{self.requirements}{suffix}.txt"

    def _base(self, uv):
        """An interpreter of the version asked for, as uv or pyenv knows it."""
        if not self.python:
            return sys.executable
        search = subprocess.run(
            [uv, "python", "find", "--no-python-downloads", self.python],
            capture_output=True,
            text=True,
        )
        if search.returncode == 0:
            return search.stdout.strip()
        if pyenv := shutil.which("pyenv"):
            versions = subprocess.run(
                [pyenv, "versions", "--bare"], capture_output=True, text=True
            )
            for version in versions.stdout.split():
                if version.startswith(f"{self.python}."):
                    prefix = subprocess.run(
                        [pyenv, "prefix", version], capture_output=True, text=True
                    )
                    return str(Path(prefix.stdout.strip()) / "bin" / "python")
        return self.python  # uv may be able to download it

    def version(self):
        """Version of the code and of its Python."""
        script = (
            "import importlib.metadata as m, platform; "
            f"print(m.version('{self.module}'), '(Python', platform.python_version() + ')')"
        )
        done = subprocess.run(
            [self.interpreter(), "-c", script], capture_output=True, text=True
        )
        return done.stdout.strip()


def _uv():
    beside = Path(sys.executable).parent / "uv"
    command = str(beside) if beside.exists() else shutil.which("uv")
    if not command:
        raise UnavailableError(
            "uv is not installed; it comes with the dev extra of this project"
        )
    return command


def _run(*command, **settings):
    environment = {**os.environ, **settings}
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, env=environment
    )
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise UnavailableError(
            " | ".join(lines[-3:]) or f"exit status {done.returncode}"
        )


ENVIRONMENTS = {
    environment.name: environment
    for environment in (
        Environment("gstlib", "gstlib"),
        Environment("aspher", "aspher", "aspher", build=True),
        Environment(
            "aspher-native",
            "aspher",
            "aspher",
            build=True,
            settings={"CMAKE_ARGS": "-DASPHER_NATIVE=ON"},
        ),
        Environment("slippy", "slippy", "slippy", python="3.10"),
        Environment("contactmechanics", "ContactMechanics", "contactmechanics"),
        Environment("tamaas", "tamaas", "tamaas"),
    )
}
