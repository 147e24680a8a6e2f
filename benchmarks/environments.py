"""An environment for each peer, made on first use from a pinned list in requirements/."""

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
OWN = "gstlib"
# Codes that do not run with the Python of this project.
PYTHONS = {"slippy": "3.10"}


class UnavailableError(Exception):
    """A code that cannot be run here; the message gives the reason in one line."""


@functools.cache
def interpreter(code):
    """The Python of a code.

    Raises
    ------
    UnavailableError
    """
    if code == OWN:
        return sys.executable
    folder = HERE / ".environments" / code
    python = folder / "bin/python"
    packages = HERE / f"requirements/{code}.txt"
    pinned_tools = packages.with_suffix(".build.txt")
    tools = ["--build-constraints", pinned_tools] if pinned_tools.exists() else []
    version = PYTHONS.get(code, sys.executable)
    print(f"preparing the environment of {code} ...", flush=True)
    _uv("venv", "--allow-existing", "--python", version, folder)
    _uv("pip", "sync", "--python", python, packages, *tools)
    return python


def version_of(code):
    """Version of a code and of its Python."""
    script = (
        "import importlib.metadata as m, platform; "
        f"print(m.version('{code}'), '(Python', platform.python_version() + ')')"
    )
    return subprocess.check_output([interpreter(code), "-c", script], text=True).strip()


def _uv(*arguments):
    beside = str(Path(sys.executable).parent)
    uv = shutil.which("uv", path=os.pathsep.join([beside, os.environ["PATH"]]))
    if not uv:
        raise UnavailableError(
            "uv is not installed; it comes with the dev extra of this project"
        )
    # One compiler at a time: its memory, and the other work on the machine.
    environment = os.environ | {"CMAKE_BUILD_PARALLEL_LEVEL": "1"}
    command = [uv, "--quiet", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise UnavailableError(
            " | ".join(lines[-3:]) or f"exit status {done.returncode}"
        )
