"""Before Snakemake starts: read the config and, for a run, see that this folder is free to run in.

Snakemake locks a folder while it runs there. A run that was killed leaves its lock; it is removed
here if nothing of that run is still alive.
"""

import argparse
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import psutil

from gstlib.errors import GstError, InputError
from gstlib.io.config_file import read_config_file
from gstlib.io.files import check_writable

# What a study makes in its folder, besides hidden parts of files.
MADE = (
    *("benchmarks", "coupling", "figures", "gesture", "hardness", "logs", "macroscale"),
    *("microscale", "power", "reference", "registered", "slip", "specimen", "surfaces", "sweep"),
    *("tables", "wear"),
    *("check.png", "index.html", "provenance.json", "report.html", "verdict.html"),
)
ROOT = Path(__file__).parents[1]
DEFAULT = ROOT / "config/config.yaml"
LOCKS = Path(".snakemake/locks")
HOST = Path(".snakemake/host")  # the machine that the last run was started on


def read_config(path: Path) -> dict:
    """The config as Snakemake merges it: the default's values where `path` states none."""
    from snakemake.utils import update_config

    config = read_config_file(DEFAULT)
    update_config(config, read_config_file(path))
    return config


def alive() -> list[int]:
    """Snakemake's processes and their jobs in this folder, on this machine, by number."""
    found = []
    for process in psutil.process_iter(["cwd", "cmdline"]):
        command = process.info["cmdline"] or []
        is_run = any(Path(word).name == "snakemake" for word in command[:3])
        is_job = any("/.snakemake/scripts/" in word for word in command)
        if process.info["cwd"] == str(Path.cwd()) and (is_run or is_job):
            found.append(process.pid)
    return found


def claim_folder(config: Path) -> None:
    """Remove the lock of a killed run; raise an `InputError` if a run is, or may be, alive."""
    check_writable(".snakemake")
    if any(LOCKS.glob("*")):
        host = HOST.read_text(encoding="utf-8") if HOST.is_file() else platform.node()
        if pids := alive():
            problem = f"a run or its jobs are still at work in this folder (processes {pids})"
            remedy = f"Wait, or end them: kill {' '.join(map(str, pids))}"
            raise InputError(Path.cwd(), problem, remedy)
        if host != platform.node():
            problem = f"a run that was started on {host} may still be at work in this folder"
            raise InputError(Path.cwd(), problem, f"If it is not, remove {LOCKS} and try again.")
        snakemake = [sys.executable, "-m", "snakemake", "--snakefile", ROOT / "Snakefile"]
        unlock = ["--unlock", "--quiet", "all", "--configfile", config]
        subprocess.run([*snakemake, *unlock], check=True)
    HOST.write_text(platform.node(), encoding="utf-8")


def clean(folder: Path) -> None:
    """Ask, and remove what a study made in `folder`; the folder too, if nothing else is in it."""
    made = [folder / name for name in MADE if (folder / name).exists()]
    made += folder.glob(".*.part*")
    if not made:
        print(f"Nothing of a study is in {folder}.")
        return
    names = ", ".join(path.name for path in made)
    if input(f"Remove from {folder}: {names}? [y/N] ") != "y":
        return
    for path in made:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    if not any(folder.iterdir()):
        folder.rmdir()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--run", action="store_true", help="see that a run can start here")
    parser.add_argument("--needs", metavar="SECTION", help="refuse a config without this section")
    parser.add_argument("--clean", action="store_true", help="remove what the study made")
    arguments = parser.parse_args()
    try:
        config = read_config(arguments.config)
        if arguments.clean:
            clean(Path(config["results"]))
        if (section := arguments.needs) and not config.get(section):
            remedy = f"Add one, as in config/{section}.yaml."
            raise InputError(arguments.config, f"has no section '{section}'", remedy)
        if arguments.run:
            check_writable(config["results"])
            claim_folder(arguments.config)
    except GstError as error:
        raise SystemExit(f"\nERROR: {error}") from None


if __name__ == "__main__":
    main()
