"""Remove the lock that a killed run left: `make unlock CONFIG=...`, unless a run is still at work.

Snakemake locks the files of a run while it is at work. Ended by force (`kill -9`, no memory left, a
power cut), it cannot take the lock away, and the next run finds it.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
from build_report import results_folder

SNAKEFILE = Path(__file__).parents[1] / "Snakefile"
LOCKS = Path(".snakemake/locks")


def locked(results: Path) -> bool:
    """Whether any file in the folder `results` is locked."""
    lines = (line for file in LOCKS.glob("*.lock") for line in file.read_text().splitlines())
    return any(results in Path(line).parents for line in lines)


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
    parser.add_argument("--explain", action="store_true", help="only say why a run finds a lock")
    arguments = parser.parse_args()
    results = results_folder(arguments.config)
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
            f"machine uses this folder: make unlock CONFIG={arguments.config}, then run the study "
            "again. Finished work is kept.",
            file=sys.stderr,
        )
        return 1
    snakemake = [sys.executable, "-m", "snakemake", "--snakefile", SNAKEFILE]
    unlock = ["--unlock", "--quiet", "all", "--configfile", arguments.config]
    subprocess.run([*snakemake, *unlock], check=True)
    print(f"{results}: unlocked.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
