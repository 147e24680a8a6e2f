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

from gst import ROOT
from gst.chain import break_in, check_links, last_took, steps_after
from gst.config import config_problems, read_config, refuse_config, refuse_study
from gst.logs import PLAN
from gst.provenance import refuse_other_study
from gstlib.errors import InputError
from gstlib.io.files import check_writable, write_whole

__all__ = ["is_report_current", "lay_out", "remove_intermediate", "remove_results", "run_study"]

# What a study makes in its folder, except hidden parts of files.
MADE = (
    "change",
    "coupling",
    "figures",
    "gesture",
    "logs",
    "macroscale",
    "microscale",
    "reference",
    "specimen",
    "surfaces",
    "tables",
    "wear",
    "check.png",
    "contents.json",
    "index.html",
    "provenance.json",
    "report.html",
    "tool.ply",
    "verdict.html",
)
# Of the folders in it, those that a reader needs; the others hold what one stage gives to the next.
READ = ("figures", "logs", "tables")
LOCKS = Path(".snakemake/locks")
HOST = Path(".snakemake/host")  # the machine on which the last run was started
# By default glibc takes new pages from the kernel for each large array, which clears them first,
# and returns them at once. Here arrays of up to 32 MB use freed memory again.
_REUSE_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(2**25), "MALLOC_TRIM_THRESHOLD_": str(2**30)}
_SCHEDULERS = {"snakemake", "gst.scheduler"}
_PLANNING = {"-n", "--dry-run", "--dryrun"}
_REFUSED = {"--config", "-C", "--configfile", "--configfiles"}  # gst reads CONFIG, too,
_REFUSED |= {"--directory", "-d", "--snakefile", "-s"}  # and looks for the results here
# What the report shows, and the logs of the steps, whose dates show when they ran.
SHOWN = ("provenance.json", "verdict.html", "tables/*.csv", "figures/**/*.png", "logs/**/*.log")


def run_study(
    config: Path, *, cores: str | None, profile: str, plan: bool, options: Sequence[str]
) -> int:
    """Run a study in the working folder, build its report, and say what to open.

    Parameters
    ----------
    config : Path
        The config file.
    cores : str, optional
        Jobs at a time on this machine: a number, or ``all``; by default those of the profile.
    profile : str
        A folder in ``profiles`` of the working folder, or of gstlib.
    plan : bool
        Only show what would run.
    options : sequence of str
        Further Snakemake options, except folder and config.

    Returns
    -------
    int
        The exit code: 0, or Snakemake's.

    Raises
    ------
    InputError
        The config cannot be used; there is no such profile; an option is refused; Snakemake is not
        installed; a run is, or may be, active in this folder.
    """
    read = read_config(config)
    refuse_study(read, str(config))
    if refused := sorted({option.partition("=")[0] for option in options} & _REFUSED):
        problem = f"{refused[0]} would make Snakemake look elsewhere than gst"
        raise InputError(
            "gst study", problem, "Give gst another CONFIG, or start it elsewhere."
        )
    plan = plan or not _PLANNING.isdisjoint(options)
    if importlib.util.find_spec("snakemake") is None:
        remedy = "Install it: pip install 'gstlib[workflow]'"
        raise InputError(
            "gst study", "Snakemake, which runs the study, is not installed", remedy
        )
    here = Path("profiles") / profile
    folder = next((each for each in (here, ROOT / here) if each.is_dir()), None)
    if folder is None:
        raise InputError(
            "--profile", f"there is no folder {here}", "See docs/how-to/cluster.md."
        )
    results = Path(read["results"])
    refuse_other_study(read)
    check_links(results)
    if not plan:
        check_writable(results)
        claim_folder(config)
    command: list[object] = ["--workflow-profile", folder]
    command += ["--cores", cores] if cores else []
    command += [*options, *(["--dry-run"] if plan else [])]
    command += ["--configfile", config, "--"]
    if code := _snakemake(*command, environment={PLAN: "1"} if plan else {}):
        return code
    if plan:
        return 0
    page, report = results / "index.html", results / "report.html"
    if broken := break_in(results, read):  # the options asked for less
        print(f"The study is not finished: {broken}.")
        return 0
    if not is_report_current(results):
        # Half a report is newer than everything that it shows, and would count as whole.
        part = report.with_name(".report.part.html")
        if code := _snakemake("--report", part, "--configfile", config, is_shown=False):
            return code
        _write_without_paths(report, part)
    print(f"Done. Open {page} in a browser.")
    print(f"The archive of the study: {report}; its tables: {results / 'tables'}")
    return 0


def _write_without_paths(report: Path, part: Path) -> None:
    """Move a report of Snakemake to its place, without the folders of this machine in it."""
    content = part.read_bytes()
    for folder in (ROOT, Path.cwd()):
        content = content.replace(f"{folder.as_posix()}/".encode(), b"")
    write_whole(report, content)
    part.unlink()


def _checked(config: Path) -> dict:
    """The whole config of a file; a `ConfigError` if it cannot be used."""
    read = read_config(config)
    refuse_config(config_problems(read), str(config))
    return read


def _snakemake(
    *arguments: object, is_shown: bool = True, environment: dict[str, str] | None = None
) -> int:
    """Run Snakemake, and return its exit code. If not shown, its output appears only on failure."""
    command = [sys.executable, "-m", "gst.scheduler", "--snakefile", ROOT / "Snakefile"]
    with tempfile.TemporaryFile("w+") as kept:
        said = None if is_shown else kept
        words = list(map(str, [*command, *arguments]))
        around = _REUSE_MEMORY | os.environ | (environment or {})
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


def is_report_current(results: Path) -> bool:
    """Whether the report exists and is no older than its contents."""
    report = results / "report.html"
    dates = [file.stat().st_mtime_ns for pattern in SHOWN for file in results.glob(pattern)]
    return report.is_file() and report.stat().st_mtime_ns >= max(dates, default=0)


def alive() -> list[int]:
    """Snakemake's processes and their jobs in this folder, on this machine, by number."""
    import psutil

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
            raise InputError(
                Path.cwd(), problem, f"If it is not, remove {LOCKS} and try again."
            )
        _snakemake("--unlock", "--configfile", config, is_shown=False)
    HOST.write_text(platform.node(), encoding="utf-8")


def remove_results(config: Path) -> None:
    """Ask, and remove what a study made in its folder; the folder too, if nothing else is in it."""
    folder = Path(_checked(config)["results"])
    made = [folder / name for name in MADE if (folder / name).exists()]
    made += folder.glob(".*.part*")
    if not made:
        print(f"{folder} contains no results of a study.")
        return
    names = ", ".join(path.name for path in made)
    if input(f"Remove from {folder}: {names}? [y/N] ") != "y":
        return
    _remove(made)
    if not any(folder.iterdir()):
        folder.rmdir()


def remove_intermediate(config: Path) -> None:
    """Ask, and remove what a finished study's stages gave to each other; its results stay.

    Raises
    ------
    InputError
        The study is not finished, or its results are not those of this config.
    """
    read = _checked(config)
    folder = Path(read["results"])
    between = [folder / name for name in MADE if name not in READ and (folder / name).is_dir()]
    if not between:
        print(f"{folder} contains no intermediate results.")
        return
    check_links(folder)
    if broken := break_in(folder, read):
        remedy = "Finish the study first: what would be removed is needed for it."
        raise InputError(folder, broken, remedy)
    names = [path.name for path in between]
    again = steps_after(folder, names)
    took_s = sum(float(took.split()[0]) for step in again if (took := last_took(folder, step)))
    print(
        f"{folder}: {_size_mb(between):.1f} of {_size_mb([folder]):.1f} MB are what one stage gave "
        f"to the next: {', '.join(names)}.\n"
        "The page, tables, figures, records and logs stay. Export and pack the study first: "
        "without these files it is no longer finished.\n"
        f"A run then takes {len(again)} steps again, which took {took_s:.0f} s in all."
    )
    if input("Remove them? [y/N] ") == "y":
        _remove(between)


def _size_mb(paths: Iterable[Path]) -> float:
    files = (file for path in paths for file in path.rglob("*") if not file.is_symlink())
    return sum(file.stat().st_size for file in files if file.is_file()) / 1e6


def _remove(paths: Iterable[Path]) -> None:
    for path in paths:
        is_folder = path.is_dir() and not path.is_symlink()
        shutil.rmtree(path) if is_folder else path.unlink()


def lay_out(folder: Path, name: str) -> list[Path]:
    """Copy a shipped config, the tables that it names and their description into a folder.

    Parameters
    ----------
    folder : Path
        Of the new study; made if it does not exist.
    name : str
        Of the config, such as ``own``.

    Returns
    -------
    list of Path
        The copies.

    Raises
    ------
    InputError
        One of the files exists already, with other content.
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
