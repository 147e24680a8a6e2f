"""The chain from the measured files to the page: what each step was given, and what it made.

A step leaves a record beside its log. It holds the step's params and the SHA-256 of every file that
it read or made. Before a run, records are compared with what the steps would be given now; whatever
differs is made again. At its end, and before anything is exported or packed, every file is compared
with the records. Contents decide: no date, no folder, and nothing that Snakemake keeps. A record is
only read and compared. Nothing is written or deleted because a record names it.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gst.received import RECORD, is_readable, places_of, read_json
from gstlib.errors import InputError
from gstlib.io.files import sha256, write_whole

__all__ = [
    "AGAIN",
    "LEVELS",
    "TOOK",
    "Step",
    "break_in",
    "certified_inputs",
    "check_chain",
    "check_links",
]
__all__ += ["given_to", "is_inside", "last_took", "made_in", "messages_of", "plan_again"]
__all__ += ["record_of", "step_of", "steps_of", "write_record"]

# What a run makes again, and why: of each such step an output, which stands for its job. The
# Snakefile fills it when it is read; `gst.scheduler` hands it to Snakemake, and the display shows
# the reasons.
AGAIN: dict[str, str] = {}
PAGE = "write_page"  # the last step: its record completes the chain
_LOGS = "logs"
_LONGEST, _LONGEST_PATH = 255, 2000  # bytes of a file's name, and of its path in the results
# Before the duration in the last line of a step's log.
TOOK = "took "
# Of the messages of its log that a step's record keeps: faults that the config accepts, warnings
# and notes (see `gstlib.errors`).
LEVELS = ("ERROR", "WARNING", "NOTE")

Record = dict[str, Any]
Digests = dict[Path, str]


class Step(NamedTuple):
    """A step as the workflow has it; a folder stands for all files in it."""

    name: str  # of its log and its record
    params: Mapping[str, Any]
    inputs: list[Path]
    outputs: list[Path]


def step_of(log: str | Path, params: Mapping, inputs: Iterable, outputs: Iterable) -> Step:
    """A step by what Snakemake knows about it."""
    read, made = ([Path(file) for file in files] for files in (inputs, outputs))
    return Step(Path(log).stem, dict(params), read, made)


def steps_of(workflow: Any, results: Path) -> list[Step]:
    """The steps of a study, from the rules that Snakemake has read.

    A rule with wildcards has a step for each of its files that other steps read.
    """
    from snakemake.iocontainers import Wildcards

    logs = results / _LOGS
    rules = [rule for rule in workflow.rules if rule.log and Path(rule.log[0]).parent == logs]
    with_wildcards = [rule for rule in rules if rule.has_wildcards()]
    jobs: list[tuple[Any, dict]] = [(rule, {}) for rule in rules if not rule.has_wildcards()]
    steps: dict[str, Step] = {}
    for rule, values in jobs:  # which grow
        wildcards = Wildcards(fromdict=values)
        inputs, outputs = rule.expand_input(wildcards)[0], rule.expand_output(wildcards)[0]
        params = rule.expand_params(wildcards, inputs, outputs, None)[0]
        step = step_of(rule.expand_log(wildcards)[0], params, inputs, outputs)
        if step.name in steps:
            continue
        steps[step.name] = step
        for file in (file for file in inputs if results in Path(file).parents):
            makers = [maker for maker in with_wildcards if maker.is_producer(file)]
            jobs += [(maker, maker.get_wildcards(file)) for maker in makers]
    return list(steps.values())


def record_of(results: Path, name: str) -> Path:
    """The file with the record of a step."""
    return results / _LOGS / f"{name}.json"


def write_record(
    results: Path, step: Step, given: Record, messages: Mapping[str, Sequence[str]]
) -> None:
    """Record a step that has ended: what it was `given`, what it made, its messages by level."""
    made = _digests(step.outputs, results, {})
    record = given | {"outputs": made, "messages": messages}
    text = json.dumps(record, indent=1, sort_keys=True, ensure_ascii=False)
    write_whole(record_of(results, step.name), f"{text}\n".encode())


def given_to(results: Path, step: Step, seen: Digests | None = None) -> Record:
    """What a step would be given now.

    ``params`` by name; ``inputs``, the SHA-256 of the study's own files by their names in the
    results, which may move; ``files``, that of all others by their paths.
    """
    seen = {} if seen is None else seen
    own = [path for path in step.inputs if path.is_relative_to(results)]
    others = [path for path in step.inputs if not path.is_relative_to(results)]
    return {
        "params": {name: _plain(value, results) for name, value in step.params.items()},
        "inputs": _digests(own, results, seen),
        "files": _digests(others, None, seen),
    }


def read_record(results: Path, name: str) -> Record | None:
    """The record of a step; None if there is none, or it is damaged or names files elsewhere."""
    try:
        record: Record = read_json(record_of(results, name), results, RECORD)
    except (OSError, InputError):
        return None
    is_whole = all(map(is_inside, [*record["inputs"], *record["outputs"]]))
    return record if is_whole and all(map(_can_be, record["files"])) else None


def plan_again(steps: Iterable[Step], results: Path) -> dict[str, str]:
    """The steps that would be given something else now, each by an output of it, and why.

    A step that has made nothing yet is not among them: Snakemake runs it anyway. The dates of all
    other files are brought into the order in which steps make them; a copy may have lost it.
    """
    seen: Digests = {}
    again: dict[str, str] = {}
    current: list[Step] = []
    for step in steps:
        if not any(path.exists() for path in step.outputs):
            continue
        if why := _difference(results, step, seen):
            again[str(step.outputs[0])] = why
        else:
            current.append(step)
    _order_dates(current)
    return again


def _difference(results: Path, step: Step, seen: Digests) -> str | None:
    """In what a step as recorded differs from the step as it would be now, in a few words."""
    record = read_record(results, step.name)
    if record is None:
        return "no record says how it was made"
    now = given_to(results, step, seen)
    if name := _changed(record["params"], now["params"]):
        before, after = (part["params"].get(name) for part in (record, now))
        return "the program has changed" if name == "code" else _turned(name, before, after)
    for part in ("files", "inputs"):
        if name := _changed(record[part], now[part]):
            return f"{name} {'is missing' if now[part].get(name) == '' else 'has changed'}"
    if name := _changed(record["outputs"], _digests(step.outputs, results, seen)):
        return f"{name} is not as it was made"
    return None


def break_in(results: Path, config: Mapping[str, Any] | None = None) -> str | None:
    """Where the chain from the measured files to the page breaks, in a sentence; None if it holds.

    With a `config`, the page must be that of this config. A measured file that is no longer in its
    place breaks nothing.
    """
    if not (steps := _steps_in(results)):
        return "this folder holds no finished study"
    made_with = _of(results, PAGE, "params").get("config")
    if config is not None and made_with != _plain(config, results):
        return "the results were made with another config"
    return next(_breaks(results, steps, config), None)


def check_chain(results: Path) -> None:
    """Raise an `InputError` if results are no finished study, or their chain is broken."""
    check_links(results)
    _refuse(results, break_in(results))


def certified_inputs(
    results: Path, steps: Iterable[str], files: Sequence[Path]
) -> dict[str, str]:
    """SHA-256, by path, of measured `files` as the `steps` read them.

    Raises an `InputError` if a file is not as its step made it, or not as a step read it.
    """
    steps = list(steps)
    _refuse(results, next(_breaks(results, steps, files), None))
    read: dict[str, str] = {}
    for each in steps:
        read |= _of(results, each, "files")
    return {str(path): read.get(str(path)) or sha256(path) for path in sorted(files, key=str)}


def _refuse(results: Path, problem: str | None) -> None:
    if problem is not None:
        remedy = "Run the study (again); it makes anew what has changed."
        raise InputError(results, problem, remedy)


def _breaks(results: Path, steps: Iterable[str], named: Any) -> Iterator[str]:
    """Every break between these steps, in a sentence; `named` is that of `places_of`."""
    places = places_of(named)
    seen: Digests = {}
    for name in steps:
        record = read_record(results, name)
        if record is None:
            yield f"no record says what the step {name} made"
            continue
        for part in ("inputs", "outputs"):
            files = [results / each for each in record[part]]
            changed = _changed(record[part], _digests(files, results, seen))
            if changed:
                file, did = results / changed, "read" if part == "inputs" else "made"
                if file.exists():
                    edited = ": cut, or edited" if part == "outputs" else ""
                    yield f"{file} is not as the step {name} {did} it{edited}"
                else:
                    yield f"{file}, which the step {name} {did}, is missing"
        known = {path: of for path, of in record["files"].items() if is_readable(path, places)}
        changed = _changed(known, _digests(map(Path, known), None, seen))
        if changed:
            yield f"{changed} is not as the step {name} read it"


def made_in(results: Path) -> list[Path]:
    """Every file of a finished study, as its steps recorded them."""
    steps = _steps_in(results)
    return [results / name for each in steps for name in _of(results, each, "outputs")]


def _steps_in(results: Path) -> list[str]:
    """The steps of a finished study, the page last; none if there is no such study."""
    page = read_record(results, PAGE)
    return [*page["params"].get("steps", []), PAGE] if page else []


def messages_of(results: Path, step: str, level: str) -> list[str]:
    """What a step reported at one of the `LEVELS` when it last ran."""
    return _of(results, step, "messages").get(level, [])


def last_took(results: Path, step: str) -> str:
    """How long a step took when it last ran, from its log; empty if that is gone."""
    log = results / _LOGS / f"{step}.log"
    text = log.read_text(encoding="utf-8") if log.is_file() else ""
    last = text.rstrip("\n").rpartition("\n")[2]
    return last.partition(TOOK)[2].partition(",")[0]


def check_links(results: Path) -> None:
    """Raise an `InputError` if a link in the results leads out: a study writes nowhere else."""
    whole = os.path.realpath(results)
    for folder, folders, files in os.walk(results):
        for name in (*folders, *files):
            path = Path(folder, name)
            if not path.is_symlink():
                continue
            real = Path(os.path.realpath(path))
            if not real.is_relative_to(whole):
                problem = f"is a link to {real}, outside the results"
                raise InputError(path, problem, "Remove the link: a study writes only there.")


def _of(results: Path, step: str, part: str) -> Any:
    record = read_record(results, step)
    return record[part] if record else {}


def is_inside(name: str) -> bool:
    """Whether a name in a record stays within the results, and can be that of a file."""
    path = Path(name)
    return _can_be(name) and not path.is_absolute() and ".." not in path.parts


def _can_be(name: str) -> bool:
    """Whether a name is no longer than that of a file."""
    sizes = [len(part.encode("utf-8", "surrogatepass")) for part in Path(name).parts]
    return max(sizes, default=0) <= _LONGEST and sum(sizes) + len(sizes) <= _LONGEST_PATH


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


def _digests(paths: Iterable[Path], results: Path | None, seen: Digests) -> dict[str, str]:
    """SHA-256 of files by name in `results`, or by path; empty for one that is missing."""
    found = {}
    for path in paths:
        files = [path]
        if path.is_dir():
            files = [file for file in sorted(path.rglob("[!.]*")) if file.is_file()]
        for file in files:
            if file not in seen:
                seen[file] = sha256(file) if file.is_file() else ""
            name = file.relative_to(results) if results else file
            found[name.as_posix()] = seen[file]
    return found


def _changed(before: Mapping[str, str], after: Mapping[str, str]) -> str | None:
    """The first file that differs, came or went, by its name."""
    names = sorted({*before, *after})
    return next((name for name in names if before.get(name) != after.get(name)), None)


def _turned(name: str, before: Any, after: Any) -> str:
    texts = [json.dumps(value, ensure_ascii=False) for value in (before, after)]
    if max(map(len, texts)) > 40:
        return f"{name} has changed"
    return f"{name} was {texts[0]}, is {texts[1]}"


def _order_dates(steps: list[Step]) -> None:
    """Give outputs that are as recorded one date if some input is younger; contents stay."""
    read = [[_dated(path).stat().st_mtime_ns for path in step.inputs] for step in steps]
    made = [[_dated(path).stat().st_mtime_ns for path in step.outputs] for step in steps]
    if any(max(old, default=0) > min(new) for old, new in zip(read, made, strict=True)):
        newest = max(date for dates in read + made for date in dates)
        for path in (path for step in steps for path in step.outputs):
            os.utime(_dated(path), ns=(newest, newest))


def _dated(path: Path) -> Path:
    """What Snakemake takes the date of an output from: of a folder, a hidden file in it."""
    stamp = path / ".snakemake_timestamp"
    return stamp if stamp.exists() else path
