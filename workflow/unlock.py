"""Remove the lock that a killed run left: `make unlock CONFIG=...`, unless a run is still at work.

Snakemake locks the files of a run while it is at work. Ended by force (`kill -9`, no memory left, a
power cut), it cannot take the lock away, and the next run finds it. The files of steps that were at
work then are removed along with it. Snakemake does know them, and makes them again by itself, but
not those of steps behind the checkpoint: it looks before it knows these steps, and what they left
would pass for finished.
"""

import argparse
import shlex
import shutil
import subprocess
import sys
from base64 import urlsafe_b64decode
from collections.abc import Iterator
from pathlib import Path

import psutil
from build_report import results_folder

from gstlib.errors import OutputError
from gstlib.io.files import check_writable

SNAKEFILE = Path(__file__).parents[1] / "Snakefile"
LOCKS = Path(".snakemake/locks")
UNFINISHED = Path(".snakemake/incomplete")


def locked(results: Path) -> bool:
    """Whether any file in the folder `results` is locked."""
    lines = (line for file in LOCKS.glob("*.lock") for line in file.read_text().splitlines())
    return any(results in Path(line).parents for line in lines)


def unfinished(results: Path) -> list[Path]:
    """Outputs, in the folder `results`, of steps that began and did not end."""
    # A mark's name is the output's in base64, long ones in pieces: folders that begin with @.
    marks = (file.relative_to(UNFINISHED).parts for file in UNFINISHED.rglob("*") if file.is_file())
    names = (urlsafe_b64decode("".join(part.removeprefix("@") for part in mark)) for mark in marks)
    files = sorted(Path(name.decode()) for name in names)
    return [file for file in files if results in file.parents and file.exists()]


def processes() -> Iterator[tuple[int, bool]]:
    """Snakemake's processes in this folder, on this machine: number, and whether a mere job."""
    for process in psutil.process_iter(["cwd", "cmdline"]):
        command = process.info["cmdline"] or []
        if process.info["cwd"] != str(Path.cwd()):
            continue
        if any("/.snakemake/scripts/" in word for word in command):
            yield process.pid, True
        elif any(Path(word).name == "snakemake" for word in command[:3]):
            yield process.pid, False


def at_work() -> str | None:
    """What is still at work in this folder, and what to do about it; None if nothing is."""
    found = dict(processes())
    runs = [pid for pid, is_job in found.items() if not is_job]
    if runs:
        return (
            f"another run is at work in this folder (process {runs[0]}). "
            "Wait for it, or end it with Ctrl-C where it was started."
        )
    if found:
        pids = " ".join(map(str, found))
        return (
            f"jobs of a killed run are still at work in this folder (processes {pids}). "
            f"Wait for them, or end them: kill {pids}"
        )
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument(
        "--explain", action="store_true", help="only say what kept a run from beginning"
    )
    arguments = parser.parse_args()
    results = results_folder(arguments.config)
    if arguments.explain:
        try:
            check_writable(Path.cwd())  # where Snakemake keeps its notes
        except OutputError as error:
            print(f"\nERROR: {error}", file=sys.stderr)
            return 1
    if not locked(results):
        if not arguments.explain:
            print(f"{results}: not locked.")
        return 0
    busy = at_work()
    if busy:
        print(f"\nERROR: {results}: {busy}", file=sys.stderr)
        return 1
    if arguments.explain:
        print(
            f"\nERROR: {results}: a run that was killed left its lock. If no run on another "
            "machine uses this folder: make unlock "
            f"CONFIG={shlex.quote(str(arguments.config))}, then run the study again. "
            "Finished work is kept.",
            file=sys.stderr,
        )
        return 1
    snakemake = [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE]
    unlock = ["--unlock", "--quiet", "all", "--configfile", arguments.config]
    subprocess.run([*snakemake, *unlock], check=True)
    removed = unfinished(results)
    for file in removed:
        shutil.rmtree(file) if file.is_dir() else file.unlink()
    print(f"{results}: unlocked. Files of unfinished steps, removed: {len(removed)}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
