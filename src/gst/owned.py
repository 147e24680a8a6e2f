"""Whose files lie in a folder of results: which of them a study may replace, and which it may not.

A study owns the files that records of its steps name. Before its first step it also lists every
file that its rules would write (`CLAIMS`), since a run may be killed before a record is there. All
other files are a user's: a study refuses to write in their place, and `gst clean` leaves them.
"""

import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from gst.chain import Step, read_record, record_of
from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = ["MOVED", "claim", "claimed_by", "move_aside", "recorded", "refuse_foreign"]
__all__ += ["removable"]

CLAIMS = ".gst_outputs"  # in the results: the files that a study would write, one a line
MOVED = "moved_aside"  # in the results: the user's files from folders that were made anew
# Snakemake puts this empty file into a folder that a step made.
_STAMP = ".snakemake_timestamp"
# A file while it is written (see `gstlib.io.files`), by its later name.
_PART = re.compile(r"\.(?P<name>.+?)(\.\d+)?\.part\d*")


def recorded(results: Path) -> set[str]:
    """Every file that some record names, by its name in the results; not records and logs."""
    names: set[str] = set()
    for record in _records(results).values():
        names |= record["outputs"].keys()
    return names


def claimed_by(results: Path) -> set[str]:
    """The files and folders that a study would write, as listed before its first step."""
    file = results / CLAIMS
    return set(file.read_text("utf-8", "replace").splitlines()) if file.is_file() else set()


def refuse_foreign(steps: Iterable[Step], results: Path) -> None:
    """End with exit code 2 if a file is in the way of the study that no study made."""
    names, claims = recorded(results), claimed_by(results)
    if names and not claims:  # the results of a version that claimed nothing
        return
    for path in _written_by(steps, results):
        if path.relative_to(results).as_posix() not in names | claims:
            for file in _in_the_way(path, results):
                problem = (
                    "a step would write in its place, and no record says that a study made it"
                )
                remedy = "Give `results` another name in the config, or move the file."
                print(f"ERROR: {InputError(file, problem, remedy)}", file=sys.stderr)
                sys.exit(2)  # Snakemake would give any other error another code


def claim(steps: Iterable[Step], results: Path) -> None:
    """List what the study would write, beside what it listed before."""
    before = claimed_by(results)
    names = {path.relative_to(results).as_posix() for path in _written_by(steps, results)}
    if not names <= before:
        write_whole(results / CLAIMS, "\n".join(sorted(names | before)).encode())


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
            if not (is_made or file.name == _STAMP or made.stem.partition("_")[0] in left):
                moved.append(_moved(file, results))
    if moved:
        print(
            f"NOTE: {len(moved)} of your files lay where steps make a folder anew, and were moved "
            f"to {results / MOVED}, such as {moved[0]}.",
            file=sys.stderr,
        )


def removable(results: Path) -> list[Path]:
    """Every file that `gst clean` may remove.

    That is what records name, the records and their logs, and what is left of a file that was not
    written to its end. No link to another folder is followed.
    """
    names, claims = recorded(results), claimed_by(results)
    files = {results / name for name in names}
    for name in _records(results):
        files |= {record_of(results, name), record_of(results, name).with_suffix(".log")}
    files = set(filter(os.path.lexists, files))
    for folder in {file.parent for file in files} | {results / name for name in claims}:
        for hidden in folder.glob(".*"):
            made = _finished(hidden).relative_to(results)
            is_part = made.name != hidden.name
            is_ours = not {made.as_posix(), *map(str, made.parents)}.isdisjoint(names | claims)
            is_stamp = hidden.name == _STAMP and hidden.lstat().st_size == 0
            files |= {hidden} if is_stamp or (is_part and is_ours) else set()
    whole = results.resolve()
    return sorted(
        file
        for file in files
        if (file.is_symlink() or file.is_file())
        and file.parent.resolve() == whole / file.parent.relative_to(results)
    )


def _records(results: Path) -> dict[str, Any]:
    """The records of all steps, by the steps' names; damaged ones are none."""
    steps = [file.stem for file in results.glob("logs/*.json") if file.is_file()]
    records = {step: read_record(results, step) for step in sorted(steps)}
    return {step: record for step, record in records.items() if record}


def _written_by(steps: Iterable[Step], results: Path) -> Iterator[Path]:
    """Files and folders that steps write, with their records and logs."""
    for step in steps:
        record = record_of(results, step.name)
        yield from (*step.outputs, record, record.with_suffix(".log"))


def _in_the_way(path: Path, results: Path) -> Iterator[Path]:
    """The files that are lost if a step writes `path`; also one in the place of its folder."""
    for each in (path, *(folder for folder in path.parents if results in folder.parents)):
        if os.path.lexists(each) and not each.is_dir():
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
    number, target = 1, aside
    while os.path.lexists(target):
        number, target = number + 1, aside.with_name(f"{aside.stem}_{number}{aside.suffix}")
    return file.rename(target)
