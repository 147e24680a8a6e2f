"""The chain from the measured files to the page: inputs and outputs of each step.

A step leaves a record beside its log. It holds the step's params and the SHA-256 of every file that
it read or made. Before a run, records are compared with what the steps would be given now; whatever
differs is made again. The page's record holds a hash of each step as the page's config asks for it.
At the end of a run, and before anything is exported or packed, steps are compared with these hashes
and files with the records. Contents decide: no date, no folder, and nothing that Snakemake keeps. A
record is only read and compared. Nothing is written or deleted because a record names it.
"""

import hashlib
import json
import os
from collections.abc import Container, Iterable, Mapping, Sequence, Set
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from gst.run.received import StepRecord, is_readable, places_of, read_json
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole

# What a run makes again, and why: of each such step an output, which stands for its job. The
# Snakefile fills it when it is read; `gst.run.scheduler` hands it to Snakemake, and the display
# shows the reasons.
AGAIN: dict[str, str] = {}
PAGE = "write_page"  # the last step: its record completes the chain
LOGS = "logs"
# Of the messages of its log that a step's record keeps: faults that the config accepts, warnings
# and notes (see `gstlib.errors`).
LEVELS = ("ERROR", "WARNING", "NOTE")

Record = dict[str, Any]


class Step(NamedTuple):
    """A step as the workflow has it; a folder stands for the files that a step made in it."""

    name: str  # of its log and its record
    params: Mapping[str, Any]
    inputs: list[Path]
    outputs: list[Path]


def step_of(
    log: str | Path, params: Mapping, inputs: Iterable, outputs: Iterable
) -> Step:
    """A step, from Snakemake's data."""
    files = ([*map(Path, paths)] for paths in (inputs, outputs))
    return Step(Path(log).stem, dict(params), *files)


def hashes_of(steps: Iterable[Step], results: Path) -> dict[str, str]:
    """By the name of each step a hash of its params and of the names of its files."""
    return {step.name: _hash(_asked(step, results)) for step in steps}


def _asked(step: Step, results: Path) -> Record:
    """The params of a step as JSON has them, and the names of its files and folders."""
    files = {"reads": step.inputs, "makes": step.outputs}
    # what a step asks of `accept` is recorded in place of all that the config accepts
    return _plain({**step.params, **files, "accept": None}, results)


def _hash(params: Record) -> str:
    text = json.dumps(params, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def record_of(results: Path, name: str) -> Path:
    """The file with the record of a step."""
    return results / LOGS / f"{name}.json"


def write_record(
    results: Path, step: Step, read: Record, messages: Mapping[str, Sequence[str]]
) -> None:
    """Record a step that has ended.

    `read` is what it was given, as `given_to` has it, and `messages` are its own by level.
    """
    record = record_of(results, step.name)
    # or a folder would stand for the files that the old record names
    record.unlink(missing_ok=True)
    made = _Contents(results).digests(step.outputs)
    whole = read | {"outputs": made, "messages": messages}
    text = json.dumps(whole, indent=1, sort_keys=True, ensure_ascii=False)
    write_whole(record, f"{text}\n".encode())


def given_to(results: Path, step: Step, contents: "_Contents | None" = None) -> Record:
    """The current inputs of a step.

    ``params`` by name, with the files and folders that it ``reads`` and ``makes``; ``inputs``, the
    SHA-256 of the study's own files by their names in the results, which may move; ``files``, that
    of all others by their paths. `gst.run.logs` adds the ``faults`` that the step asked about, each
    with whether it was accepted, and the ``software`` that the step ran on.
    """
    contents = contents or _Contents(results)
    own = {path for path in step.inputs if path.is_relative_to(results)}
    others = {*step.inputs} - own
    return {
        "params": _asked(step, results),
        "inputs": contents.digests(own),
        "files": contents.digests(others),
        "faults": {},
        "software": {},
    }


def read_record(results: Path, name: str) -> Record | None:
    """The record of a step; None if there is none, or it is damaged or names files elsewhere."""
    try:
        record: Record = read_json(record_of(results, name), results, StepRecord)
    except (OSError, InputError):
        return None
    names = [*record["inputs"], *record["outputs"], *record["params"]["makes"]]
    return record if all(map(is_inside, names)) else None


def plan_again(
    steps: Iterable[Step], results: Path, accepted: Container[str] = ()
) -> dict[str, str]:
    """The steps that would be given something else now, each by an output of it, and why.

    `accepted` are the faults that the config accepts. A step that has made nothing yet is not
    among the steps: Snakemake runs it anyway.
    """
    contents = _Contents(results)
    reasons: dict[str, str] = {}
    for step in steps:
        has_begun = any(path.exists() for path in step.outputs)
        if has_begun and (reason := _difference(step, contents, accepted)):
            reasons[str(step.outputs[0])] = reason
    return reasons


def _difference(
    step: Step, contents: "_Contents", accepted: Container[str]
) -> str | None:
    """In what a step as recorded differs from the step as it would be now, in a few words."""
    record = read_record(contents.results, step.name)
    if record is None:
        return "no record shows how it was made"
    now = given_to(contents.results, step, contents)
    for part in ("files", "inputs"):
        if name := _changed(record[part], now[part]):
            return _changed_file(name, record[part], now[part])
    if name := _changed(record["params"], now["params"]):
        values = (each["params"].get(name) for each in (record, now))
        return _changed_param(name, *values)
    if name := _changed(record["outputs"], contents.digests(step.outputs)):
        return f"{name} is not as it was made"
    return _judged_otherwise(record, accepted)


def _changed_file(name: str, before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """In words, that a file that a step reads has changed, came or went."""
    if name not in now:
        return f"{name} is no longer read"
    if now[name] == "":
        return f"{name} is missing"
    return f"{name} has changed" if name in before else f"{name} is new"


def _changed_param(name: str, *values: Any) -> str:
    """In words, that a param was the first of two values and is the second."""
    if name == "code":
        return "the program has changed"
    before, after = (json.dumps(value, ensure_ascii=False) for value in values)
    is_long = max(len(before), len(after)) > 40
    return f"{name} has changed" if is_long else f"{name} was {before}, is {after}"


def _judged_otherwise(record: Record, accepted: Container[str]) -> str | None:
    """A fault that a step accepted and a config does not, or the other way round, in words."""
    for name, was_accepted in sorted(record["faults"].items()):
        if was_accepted != (name in accepted):
            return f"whether {name} is accepted has changed"
    return None


def break_in(results: Path, config: Mapping[str, Any] | None = None) -> str | None:
    """Where the chain from the measured files to the page breaks, in a sentence; None if it holds.

    With a `config`, the page must be that of this config. A measured file that is no longer in its
    place breaks nothing.
    """
    if not (steps := steps_in(results)):
        return "this folder holds no finished study"
    made_with = _part_of(results, PAGE, "params").get("config", {})
    if config is not None and made_with != _plain(config, results):
        return "the results were made with another config"
    accepted = made_with.get("accept", ())
    return _first_break(results, steps, places_of(config), accepted)


def other_files(results: Path, files: Iterable[str]) -> str | None:
    """A file that came or went since the page was made, in a sentence; None if there is none.

    `files` are the user's, as the study would read them now: a name in the patch table may fit
    others than before.
    """
    before, now = set(_part_of(results, PAGE, "files")), set(files)
    for file in sorted(before ^ now):
        if file in now:
            return f"the page was made without {file}, which the study reads now"
        return f"the page was made with {file}, which the study no longer reads"
    return None


def check_chain(results: Path) -> None:
    """Raise an `InputError` if results are no finished study, or their chain is broken."""
    check_links(results)
    _refuse(results, break_in(results))


def certified_inputs(
    results: Path, steps: Mapping[str, str], files: Sequence[Path]
) -> dict[str, str]:
    """SHA-256, by path, of measured `files` as the `steps` read them (`hashes_of` gives these).

    Raises an `InputError` if a step was asked something else, or if a file is not as its step made
    it, or not as a step read it.
    """
    _refuse(results, _first_break(results, steps, places_of(files)))
    read: dict[str, str] = {}
    for each in steps:
        read |= _part_of(results, each, "files")
    names = sorted(map(str, files))
    return {name: read.get(name) or sha256(name) for name in names}


def versions_of(results: Path, steps: Iterable[str]) -> dict[str, str]:
    """The version of each package on which the steps ran; all of them where steps differ."""
    versions: dict[str, set[str]] = {}
    for step in steps:
        for name, version in _part_of(results, step, "software").items():
            versions.setdefault(name, set()).add(version)
    return {
        name: "mixed: " * (len(each) > 1) + ", ".join(sorted(each))
        for name, each in sorted(versions.items())
    }


def _refuse(results: Path, problem: str | None) -> None:
    if problem is not None:
        remedy = "Run the study. It repeats only the affected steps."
        raise InputError(results, problem, remedy)


def _first_break(
    results: Path,
    steps: Mapping[str, str | None],
    places: Set[Path],
    accepted: Container[str] | None = None,
) -> str | None:
    """The first break between these steps, in a sentence; `places` are those of measured files."""
    records = {}
    for name, step_hash in steps.items():
        record = read_record(results, name)
        if record is None:
            return f"no record lists the files that the step {name} made"
        records[name] = record
        if step_hash not in (None, _hash(record["params"])):
            return f"the step {name} was made with other params or files than the config gives"
        if accepted is not None and (fault := _judged_otherwise(record, accepted)):
            return f"{fault} since the step {name} was made"
    return _edited_file(results, records, places)


def _edited_file(
    results: Path, records: Mapping[str, Record], places: Set[Path]
) -> str | None:
    """The first file that is not as the records have it; its maker is named before its readers."""
    contents = _Contents(results)
    for part, verb in (("outputs", "made"), ("inputs", "read"), ("files", "read")):
        for name, record in records.items():
            for file, digest in record[part].items():
                path = Path(file) if part == "files" else results / file
                is_gone = part == "files" and not is_readable(path, places)
                if is_gone or contents.digest(path) == digest:
                    continue  # measured files may be gone
                if os.path.exists(path):
                    return f"{path} is not as the step {name} {verb} it"
                return f"{path}, which the step {name} {verb}, is missing"
    return None


def made_in(results: Path) -> list[Path]:
    """Every file of a finished study, as its steps recorded them."""
    steps = steps_in(results)
    made = (_part_of(results, step, "outputs") for step in steps)
    return [results / name for files in made for name in files]


def steps_in(results: Path) -> dict[str, str | None]:
    """The steps of a finished study with their hashes, the page last; none if there is none."""
    steps = _part_of(results, PAGE, "params").get("steps")
    return {**steps, PAGE: None} if isinstance(steps, dict) else {}


def messages_of(results: Path, step: str, level: str) -> list[str]:
    """Messages of a step at one of the `LEVELS`, from its last run."""
    return _part_of(results, step, "messages").get(level, [])


def check_links(results: Path) -> None:
    """Raise an `InputError` if a link in the results leads out: a study writes nowhere else."""
    whole = os.path.realpath(results)
    for path in filter(Path.is_symlink, results.rglob("*")):
        real = Path(os.path.realpath(path))
        if not real.is_relative_to(whole):
            problem = f"is a link to {real}, outside the results"
            remedy = "Remove the link: a study writes only there."
            raise InputError(path, problem, remedy)


def _part_of(results: Path, step: str, part: str) -> dict[str, Any]:
    record = read_record(results, step)
    return record[part] if record else {}


def is_inside(name: str) -> bool:
    """Whether a name in a record stays within the results."""
    return not Path(name).is_absolute() and ".." not in Path(name).parts


def _plain(value: Any, results: Path) -> Any:
    """A param as JSON has it: paths in the results relative to them, null for an empty number."""
    if isinstance(value, Mapping):  # the config, too, names the folder
        parts = {str(name): _plain(each, results) for name, each in value.items()}
        return parts | ({"results": "."} if "results" in parts else {})
    if isinstance(value, list | tuple):
        return [_plain(each, results) for each in value]
    if isinstance(value, str | Path):
        inside = results in Path(value).parents
        return Path(value).relative_to(results).as_posix() if inside else str(value)
    return None if value is None or value != value else value


class _Contents:
    """SHA-256 of files by name in the results, or by path; each file is read once."""

    def __init__(self, results: Path):
        self.results = results
        self.digest = cache(lambda file: sha256(file) if os.path.isfile(file) else "")

    def digests(self, paths: Iterable[Path]) -> dict[str, str]:
        """Of these files, and of those in these folders; empty for one that is missing."""
        files = [file for path in paths for file in self._files_of(path)]
        return {_plain(file, self.results): self.digest(file) for file in files}

    def _files_of(self, path: Path) -> list[Path]:
        """Of a folder the files that its step recorded: other programs leave theirs there, too."""
        if not os.path.isdir(path):
            return [path]
        if maker := self._makers.get(_plain(path, self.results)):
            made = (self.results / name for name in maker["outputs"])
            return [file for file in made if file.is_relative_to(path)]
        return [file for file in sorted(path.rglob("[!.]*")) if file.is_file()]

    @cached_property
    def _makers(self) -> dict[str, Record]:
        """The record of the step that made a file or a folder, by its name in the results."""
        return {
            name: record
            for file in sorted(self.results.glob(f"{LOGS}/*.json"))
            if (record := read_record(self.results, file.stem))
            for name in record["params"]["makes"]
        }


def _changed(before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """The first name whose value differs, came or went."""
    names = sorted({*before, *after})
    return next((name for name in names if before.get(name) != after.get(name)), None)
