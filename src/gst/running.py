"""A study from its config to its page: what `gst study` does around Snakemake.

Snakemake locks a folder while it runs there. A killed run leaves its lock behind; this module
removes it if no process of that run is still alive.
"""

import importlib.util
import os
import platform
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import psutil

from gst import ROOT
from gst.chain import break_in, check_links
from gst.config import config_problems, read_config, refuse_config, refuse_study
from gst.logs import PLAN
from gst.provenance import refuse_other_study
from gst.strict_yaml import read_yaml
from gstlib.errors import InputError
from gstlib.io.files import check_writable, write_whole

__all__ = ["former_layout", "lay_out", "remove_results", "run_study"]

# Folders of the results that a reader needs, and those with what one stage gives to the next.
READ = ("figures", "logs", "tables")
BETWEEN = (
    "change",
    "coupling",
    "gesture",
    "macroscale",
    "microscale",
    "reference",
    "specimen",
    "surfaces",
    "use",
    "wear",
)
# What a study makes in its folder, except hidden parts of files.
MADE = (
    *BETWEEN,
    *READ,
    "check.png",
    "contents.json",
    "index.html",
    "provenance.json",
    "tool.ply",
)
LOCKS = Path(".snakemake/locks")
HOST = Path(".snakemake/host")  # the machine on which the last run was started
# By default glibc takes new pages from the kernel for each large array, which clears them first,
# and returns them at once. Here arrays of up to 32 MB use freed memory again.
_REUSE_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(2**25), "MALLOC_TRIM_THRESHOLD_": str(2**30)}
_SCHEDULERS = {"snakemake", "gst.scheduler"}
_PLANNING = {"-n", "--dry-run", "--dryrun"}
_REFUSED = {"--config", "-C", "--configfile", "--configfiles"}  # gst reads CONFIG, too,
_REFUSED |= {"--directory", "-d", "--snakefile", "-s"}  # and looks for the results here


def run_study(
    config: Path, *, cores: str | None, profile: str, plan: bool, options: Sequence[str]
) -> int:
    """Run a study in the working folder, and say what to open; the exit code is Snakemake's.

    `cores`, `profile` and `plan` are as on the command line; `options` are further ones of
    Snakemake. Raises an `InputError` if the config cannot be used; there is no such profile, or no
    Slurm for it; an option is refused; Snakemake is not installed; a run is, or may be, active in
    this folder.
    """
    read = read_config(config)
    refuse_study(read, str(config))
    if refused := sorted({option.partition("=")[0] for option in options} & _REFUSED):
        problem = f"{refused[0]} would make Snakemake look elsewhere than gst"
        remedy = "Give gst another CONFIG, or start it elsewhere."
        raise InputError("gst study", problem, remedy)
    if importlib.util.find_spec("snakemake") is None:
        problem = "Snakemake, which runs the study, is not installed"
        raise InputError("gst study", problem, "Install it: pip install 'gstlib[workflow]'")
    here = Path("profiles") / profile
    folder = next((each for each in (here, ROOT / here) if each.is_dir()), None)
    if folder is None:
        raise InputError(
            "--profile", f"there is no folder {here}", "See docs/how-to/cluster.md."
        )
    settings = read_yaml(folder / "config.yaml")
    if settings.get("executor") == "slurm" and shutil.which("sbatch") is None:
        problem = "this profile hands jobs to Slurm, and there is no sbatch on this machine"
        raise InputError(
            folder, problem, "Start the study where Slurm is, or without --profile."
        )
    results = Path(read["results"])
    refuse_other_study(read)
    check_links(results)
    if former := former_layout(results):
        print(former, file=sys.stderr)
    plan = plan or not _PLANNING.isdisjoint(options)
    if not plan:
        check_writable(results)
        claim_folder(config)
    command: list[object] = ["--configfile", config, "--workflow-profile", folder]
    command += ["--cores", cores] if cores else []
    command += ["--dry-run"] if plan else []
    code = _snakemake(*command, *options, environment={PLAN: "1"} if plan else {})
    if code or plan:
        return code
    if broken := break_in(results, read):  # the options asked for less
        print(f"The study is not finished: {broken}.")
        return 0
    print(f"Done. Open {results / 'index.html'} in a browser.")
    return 0


def _snakemake(
    *arguments: object, is_shown: bool = True, environment: dict[str, str] | None = None
) -> int:
    """Run Snakemake, and return its exit code. If not shown, its output appears only on failure."""
    command = [sys.executable, "-m", "gst.scheduler", "--snakefile", ROOT / "Snakefile"]
    words = list(map(str, [*command, *arguments]))
    around = _REUSE_MEMORY | os.environ | (environment or {})
    with tempfile.TemporaryFile("w+") as kept:
        said = None if is_shown else kept
        # in a group of its own: Ctrl-C would end the jobs in the middle of their imports, too
        with subprocess.Popen(
            words, stdout=said, stderr=said, env=around, process_group=0
        ) as process:
            for number in (signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, lambda *_: process.terminate())
            while process.returncode is None:
                try:
                    process.wait()
                except KeyboardInterrupt:
                    process.send_signal(signal.SIGINT)  # it ends its jobs itself
        if process.returncode:
            kept.seek(0)
            print(kept.read(), end="", file=sys.stderr)
    return process.returncode


def former_layout(results: Path) -> str | None:
    """What to know of a folder with results of a former layout, until it has records of a run."""
    old = sorted([*results.glob("logs/*.sha256"), *results.glob("surfaces/*_T*.h5")])
    if not old or any(results.glob("logs/*.json")):
        return None
    return (
        f"{results} holds results of a former layout, such as {old[0]}. They stay as they are, and "
        "the study makes its own beside them; to keep the two apart, name another folder as "
        "results."
    )


def alive() -> list[int]:
    """Snakemake's processes and their jobs in this folder, on this machine, by number."""
    found = []
    for process in psutil.process_iter(["cwd", "cmdline"]):
        command = process.info["cmdline"] or []
        is_run = any(Path(word).name in _SCHEDULERS for word in command[:3])
        is_job = any("/.snakemake/scripts/" in word for word in command)
        if process.info["cwd"] == str(Path.cwd()) and (is_run or is_job):
            found.append(process.pid)
    return found


def claim_folder(config: Path) -> None:
    """Remove the lock of a killed run; raise an `InputError` if a run is, or may be, active."""
    check_writable(".snakemake")
    if any(LOCKS.glob("*")):
        host = HOST.read_text(encoding="utf-8") if HOST.is_file() else platform.node()
        if pids := alive():
            problem = f"a run or its jobs are still at work in this folder (processes {pids})"
            remedy = f"Wait, or end them: kill {' '.join(map(str, pids))}"
            raise InputError(Path.cwd(), problem, remedy)
        if host != platform.node():
            problem = f"a run that was started on {host} may still be at work in this folder"
            remedy = f"If it is not, remove {LOCKS} and try again."
            raise InputError(Path.cwd(), problem, remedy)
        _snakemake("--unlock", "--configfile", config, is_shown=False)
    HOST.write_text(platform.node(), encoding="utf-8")


def remove_results(config: Path, *, intermediate: bool) -> None:
    """Ask, and remove what a study made in its folder; the folder too, if nothing else is in it.

    Or only the `intermediate` results, which its stages gave to each other; an `InputError` if the
    study is not finished, or not that of this config.
    """
    read = read_config(config)
    refuse_config(config_problems(read), str(config))
    folder = Path(read["results"])
    made = [folder / name for name in (BETWEEN if intermediate else MADE)]
    made = [path for path in made if path.exists()]
    made += [] if intermediate else folder.glob(".*.part*")
    if not made:
        what = "intermediate results" if intermediate else "results of a study"
        print(f"{folder} contains no {what}.")
        return
    if intermediate:
        check_links(folder)
        if broken := break_in(folder, read):
            remedy = "Finish the study first: what would be removed is needed for it."
            raise InputError(folder, broken, remedy)
        print(
            f"{_size_mb(made):.1f} of {_size_mb([folder]):.1f} MB are what one stage gave to the "
            "next. The page, tables, figures, records and logs stay. Export and pack the study "
            "first: without these files it is no longer finished, until a run makes them again."
        )
    names = ", ".join(path.name for path in made)
    if input(f"Remove from {folder}: {names}? [y/N] ") != "y":
        return
    for path in made:
        is_folder = path.is_dir() and not path.is_symlink()
        shutil.rmtree(path) if is_folder else path.unlink()
    if not any(folder.iterdir()):
        folder.rmdir()


def _size_mb(paths: Iterable[Path]) -> float:
    files = (file for path in paths for file in path.rglob("*") if not file.is_symlink())
    return sum(file.stat().st_size for file in files if file.is_file()) / 1e6


def lay_out(folder: Path, name: str) -> list[Path]:
    """Copy a shipped config, the tables that it names and their description; the copies.

    Raises an `InputError` if one of the files exists already, with other content.
    """
    config = read_config(ROOT / f"config/{name}.yaml")
    tables = [config["patches"], config["published"]]
    files = ["config/README.md", f"config/{name}.yaml", *filter(None, tables)]
    copies = {folder / file: (ROOT / file).read_bytes() for file in files}
    changed = [file for file in copies if file.exists() and file.read_bytes() != copies[file]]
    if there := ", ".join(map(str, changed)):
        remedy = "Name another folder, or remove them."
        raise InputError(folder, f"already has {there} with other content", remedy)
    for file, content in copies.items():
        write_whole(file, content)
    return list(copies)
