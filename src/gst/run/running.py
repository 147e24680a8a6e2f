"""A study from its config to its page: the work of `gst study` around Snakemake.

Whose the files in the results are, and which run may write them, is known to `gst.run.owned`.
"""

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from gst import ROOT
from gst.config.contradictions import files_read
from gst.config.reading import read_config, read_study, refuse_study
from gst.config.strict_yaml import read_yaml
from gst.run.chain import break_in, check_links, other_files
from gst.run.logs import PLAN
from gst.run.owned import NO_RUN, RESULTS, locked, refuse_links
from gst.run.provenance import refuse_other_study
from gstlib.errors import InputError
from gstlib.io.files import check_writable, write_whole

# By default glibc takes new pages from the kernel for each large array, which clears them first,
# and returns them at once. Here arrays of up to 32 MB use freed memory again.
_REUSE_MEMORY = {
    "MALLOC_MMAP_THRESHOLD_": str(2**25),
    "MALLOC_TRIM_THRESHOLD_": str(2**30),
}
# Nothing in the working folder is a module or a profile unless the command line names it: a study
# that somebody received must run no code of its own.
_NO_OTHER_CODE = {"PYTHONSAFEPATH": "1", "SNAKEMAKE_PROFILE": "none"}
# -n may be joined with other options that take no value
_PLANNING = re.compile("--dry.*|-[aDFSfklpt]*n.*")
# Snakemake would wait for ever.
_NO_CORES = re.compile(r"(?:^| )(?:--cores|--jobs|-[cj])[ =]?0+(?= |$)")
_REFUSED = (
    "--configfiles",  # gst reads CONFIG, too,
    "--directory",  # and looks for the results here
    "--snakefile",
    "--no-hooks",  # which move a user's files aside
    "--trust-io-cache",  # a pickle in the folder
)
_REFUSED_SHORT = "-C", "-d", "-s"


def run_study(
    config: Path,
    *,
    cores: str | None,
    profile: str,
    plan: bool,
    options: Sequence[str],
    here: Path | None = None,
) -> int:
    """Run a study in the working folder, print the path of the page, return Snakemake's code.

    `cores`, `profile` and `plan` are as on the command line; `options` are further ones of
    Snakemake; a profile, and what is to be opened, are named from `here`, by default the working
    folder. Raises an `InputError` if the config cannot be used; there is no such profile, or no
    Slurm for it; an option is refused; Snakemake is not installed; a run is, or may be, active in
    this folder.
    """
    read = read_config(config)
    refuse_study(read, str(config))
    if refused := list(filter(_is_refused, options)):
        problem = f"{refused[0]} would make Snakemake look elsewhere than gst"
        remedy = "Leave it out. Give gst another CONFIG, or start it elsewhere."
        raise InputError("gst study", problem, remedy)
    given = ["--cores", cores] if cores else []
    if _NO_CORES.search(" ".join([*given, *options])):
        raise InputError("--cores", "0 cores run no step", "Give 1 or more, or all.")
    if importlib.util.find_spec("snakemake") is None:
        problem = "Snakemake, which runs the study, is not installed"
        remedy = "Install it: pip install 'gstlib[workflow]'"
        raise InputError("gst study", problem, remedy)
    shipped = ROOT / "profiles" / profile
    folder = (here or Path()) / profile if os.sep in profile else shipped
    if not folder.is_dir():
        remedy = "Name default, slurm, or your own folder by its path, such as ./profiles/mine."
        raise InputError("--profile", f"there is no folder {folder}", remedy)
    settings = read_yaml(folder / "config.yaml")
    if settings.get("executor") == "slurm" and shutil.which("sbatch") is None:
        problem = (
            "this profile hands jobs to Slurm, and there is no sbatch on this machine"
        )
        remedy = "Start the study where Slurm is, or without --profile."
        raise InputError(folder, problem, remedy)
    results = Path(read["results"])
    refuse_other_study(read)
    check_links(results)
    plan = plan or any(map(_PLANNING.fullmatch, options))
    command = ["--configfile", config, "--workflow-profile", folder, *given]
    if plan:
        code = _snakemake(*command, "--dry-run", *options, environment={PLAN: "1"})
    else:
        check_writable(".snakemake")
        refuse_links(Path(".snakemake"))
        with locked(results):
            mark = {RESULTS: str(results.resolve())}
            code = _snakemake(*command, *options, environment=mark)
    if code or plan:
        return 0 if code == NO_RUN else code
    # the options asked for less, or the config was edited meanwhile
    read = read_config(config)
    broken = break_in(results, read) or other_files(
        results, files_read(read, read_study(read, str(config)))
    )
    if broken:
        print(f"The study is not finished: {broken}.")
        return 0
    page = os.path.relpath(results / "index.html", here or Path())
    print(f"Done. Open {page} in a browser.")
    return 0


def _is_refused(option: str) -> bool:
    """Whether Snakemake takes an option for one that is refused; it may be cut, or joined."""
    if option.startswith(_REFUSED_SHORT):
        return True
    name = option.partition("=")[0]
    return len(name) > 3 and any(each.startswith(name) for each in _REFUSED)


def _snakemake(*arguments: object, environment: dict[str, str]) -> int:
    """Run Snakemake, and return its exit code; the lock is that of gst."""
    command = sys.executable, "-m", "gst.run.scheduler", "--nolock"
    words = [*map(str, (*command, "--snakefile", ROOT / "Snakefile", *arguments))]
    around = _REUSE_MEMORY | os.environ | _NO_OTHER_CODE | environment
    # an entry without a name is the working folder
    named = filter(None, around.get("PYTHONPATH", "").split(os.pathsep))
    around["PYTHONPATH"] = os.pathsep.join(map(os.path.abspath, named))
    # in a group of its own: Ctrl-C would end the jobs in the middle of their imports, too
    with subprocess.Popen(words, env=around, process_group=0) as process:
        for number in (signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) != signal.SIG_IGN:  # as nohup asks
                signal.signal(number, lambda *_: process.terminate())
        while process.returncode is None:
            try:
                process.wait()
            except KeyboardInterrupt:
                process.send_signal(signal.SIGINT)  # it ends its jobs itself
    return process.returncode


def lay_out(folder: Path, name: str) -> list[Path]:
    """Copy a shipped config, the tables that it names and their description; the copies.

    Raises an `InputError` if one of the files exists already, with other content.
    """
    config = read_config(ROOT / f"config/{name}.yaml")
    tables = [config["patches"], config["published"]]
    files = ["config/README.md", f"config/{name}.yaml", *filter(None, tables)]
    copies = {folder / file: (ROOT / file).read_bytes() for file in files}
    changed = [
        str(file)
        for file, content in copies.items()
        if file.exists() and file.read_bytes() != content
    ]
    if changed:
        problem = f"already has {', '.join(changed)} with other content"
        raise InputError(folder, problem, "Name another folder, or remove them.")
    for file, content in copies.items():
        write_whole(file, content)
    return list(copies)
