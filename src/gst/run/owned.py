"""Whose files lie in a folder of results: which of them a study may replace, and which it may not.

A study owns the files that records of its steps name. Before its first step it also lists every
file that its rules would write (`CLAIMS`), since a run may be killed before a record is there. All
other files are a user's, and a study refuses to write in their place.

One run at a time writes into the folder, which holds its lock. Every process of a run has the
folder in its environment, so that jobs which outlive a killed run are seen, too.
"""

import itertools
import os
import platform
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

import psutil
from filelock import SoftFileLock, Timeout

from gst.config.renamed import STEPS
from gst.run.chain import Step, is_inside, read_record, record_of
from gst.run.received import AnyRecord, read_json, regular_file
from gstlib.errors import InputError
from gstlib.io.files import check_writable, write_whole

# In the results: the files that a study would write, one a line; the user's files from folders
# that were made anew.
CLAIMS = ".gst_outputs"
MOVED = "moved_aside"
# In the results, while a run is at work there: its process and its machine.
LOCK = ".gst_lock"
# Environment variable of every process of a run: the results that it writes.
RESULTS = "GSTLIB_RESULTS"
# Exit code of Snakemake, as `gst study` starts it, if it was asked for something else than a run:
# a plan, a list, a graph.
NO_RUN = 3
# Snakemake's empty file in each folder that a step made.
_STAMP = ".snakemake_timestamp"
_LONGEST_NAME = 1000  # of a claim
_PICTURE = "check.png"  # of `gst check`, which makes no record
# A file while it is written (see `gstlib.io.files`), by its later name.
_PART = re.compile(r"\.(?P<name>.+?)(\.\d+)?\.part\d*")


def recorded(results: Path) -> set[str]:
    """The records of steps, their logs and all files that they name, by name in the results.

    Records of a former version count, too, although their steps run again.
    """
    names: set[str] = set()
    for file in filter(Path.is_file, results.glob("logs/*.json")):
        with suppress(InputError, OSError):
            made = read_json(file, results, AnyRecord)["outputs"]
            names |= _inside([*made, f"logs/{file.name}", f"logs/{file.stem}.log"])
    return names


def claimed_by(results: Path) -> set[str]:
    """The files and folders that a study would write, as listed before its first step."""
    file = results / CLAIMS
    with suppress(InputError):
        lines = regular_file(file, results).read_text("utf-8", "replace").splitlines()
        return _inside(name for name in lines if len(name) <= _LONGEST_NAME)
    return set()


def _inside(names: Iterable[str]) -> set[str]:
    """Those that are names of files in the results, and not of the folder itself."""
    return {name for name in names if Path(name).parts and is_inside(name)}


def refuse_foreign(steps: Iterable[Step], results: Path) -> None:
    """End with exit code 2 if a file is in the way of the study that no study made."""
    _refuse_earlier(results)
    owned = recorded(results) | claimed_by(results)
    for path in written_by(steps, results):
        name = path.relative_to(results).as_posix()
        # a user's files among the study's own are moved aside
        if name in owned or any(each.startswith(f"{name}/") for each in owned):
            continue
        for file in _in_the_way(path, results):
            if file.relative_to(results).as_posix() in owned:
                continue
            problem = "a step would write in its place, and no record shows that a study made it"
            _end(file, problem, "move the file")


def _refuse_earlier(results: Path) -> None:
    """End with exit code 2 if an earlier version made these results, under other names."""
    if any(record_of(results, step).is_file() for step in STEPS):
        made = "contains the results of an earlier version"
        problem = f"{made}, whose steps and tables had other names"
        _end(results, problem, "remove the folder")


def _end(path: Path, problem: str, remedy: str) -> NoReturn:
    """End with exit code 2: Snakemake would give an error another code."""
    remedy = f"Give `results` another name in the config, or {remedy}."
    print(f"ERROR: {InputError(path, problem, remedy)}", file=sys.stderr)
    sys.exit(2)


def refuse_links(folder: Path) -> None:
    """Refuse links in Snakemake's own folder, through which it would write elsewhere."""
    for path in (folder, *folder.iterdir()):
        if path.is_symlink():
            remedy = "Remove it: Snakemake writes into this folder."
            raise InputError(path, "is a link", remedy)


def claim(files: Iterable[Path], results: Path) -> None:
    """List files and folders that are about to be written, beside those listed before."""
    before = claimed_by(results)
    names = {path.relative_to(results).as_posix() for path in files}
    if not names <= before:
        write_whole(results / CLAIMS, "\n".join(sorted(names | before)).encode())


def claim_picture(results: Path) -> Path | None:
    """Path for the picture of `gst check`, or None if a user's own file lies there."""
    picture = results / _PICTURE
    if os.path.lexists(picture) and (
        _PICTURE not in claimed_by(results) or picture.is_symlink()
    ):
        return None
    claim([picture], results)
    return picture


def move_aside(jobs: Iterable[Any], results: Path, patches: Sequence[str]) -> None:
    """Save a user's files from the folders that Snakemake empties before these jobs.

    A job that was killed has no record; what it left there is named after the `patches`.
    """
    names, moved = recorded(results), []
    for job in (job for job in jobs if job.log):
        left = set() if read_record(results, Path(job.log[0]).stem) else set(patches)
        for file in (file for folder in job.output for file in _files_in(Path(folder))):
            made = _finished(file)
            is_made = made.relative_to(results).as_posix() in names
            is_left = made.stem.partition("_")[0] in left
            if not (is_made or is_left or file.name == _STAMP):
                moved.append(_moved(file, results))
    if moved:
        print(
            f"NOTE: {len(moved)} of your files lay where steps make a folder anew, and were moved "
            f"to {results / MOVED}, such as {moved[0]}.",
            file=sys.stderr,
        )


def alive(results: Path) -> list[int]:
    """The processes of a run on this machine that writes these results, by number."""
    mark = str(results.resolve())
    return [
        each.pid
        for each in psutil.process_iter(["environ"])
        if (each.info["environ"] or {}).get(RESULTS) == mark
    ]


@contextmanager
def locked(results: Path) -> Iterator[None]:
    """Keep other runs out of a folder of results; the lock of a dead process is taken over.

    Raises an `InputError` if a run is, or may be, active there.
    """
    check_writable(results)
    file = results / LOCK
    lock = SoftFileLock(file)
    try:
        with lock.acquire(timeout=0):
            if pids := alive(results):
                raise _at_work(results, pids)
            yield
    except Timeout:
        if lock.pid is None:
            raise InputError(file, "is no lock of gst", "Remove it.") from None
        host = file.read_text("utf-8").split()[1]
        if host.partition("?")[0] == platform.node():
            raise _at_work(results, [lock.pid]) from None
        problem = (
            f"a run that was started on {host} may still be at work on these results"
        )
        remedy = f"If it is not, remove {file} and try again."
        raise InputError(results, problem, remedy) from None


def _at_work(results: Path, pids: Sequence[int]) -> InputError:
    problem = f"a run or its jobs are still at work on these results (processes {pids})"
    remedy = f"Wait, or end them: kill {' '.join(map(str, pids))}"
    return InputError(results, problem, remedy)


def written_by(steps: Iterable[Step], results: Path) -> Iterator[Path]:
    """Files and folders that steps write, with their records and logs."""
    for step in steps:
        record = record_of(results, step.name)
        yield from (*step.outputs, record, record.with_suffix(".log"))


def _in_the_way(path: Path, results: Path) -> Iterator[Path]:
    """The files that are lost if a step writes `path`; also one in the place of its folder."""
    for each in (path, *path.parents):
        if results in each.parents and os.path.lexists(each) and not each.is_dir():
            yield each
    yield from _files_in(path)


def _files_in(folder: Path) -> Iterator[Path]:
    """Files in a folder and in those below; a link is one, and is not followed."""
    if folder.is_dir():
        for path in sorted(folder.rglob("*")):
            if path.is_symlink() or not path.is_dir():
                yield path


def _finished(file: Path) -> Path:
    """The file itself, or the one that a hidden part of it would have become."""
    part = _PART.fullmatch(file.name)
    return file.with_name(part["name"]) if part else file


def _moved(file: Path, results: Path) -> Path:
    """Move a file, within the results, to where no file is yet."""
    aside = results / MOVED / file.relative_to(results)
    aside.parent.mkdir(parents=True, exist_ok=True)
    return file.rename(free_name(aside))


def free_name(path: Path) -> Path:
    """The path, with a number if something lies there already."""
    numbered = (path.with_stem(f"{path.stem}_{n}") for n in itertools.count(2))
    names = itertools.chain([path], numbered)
    return next(name for name in names if not os.path.lexists(name))
