"""The log of a job: one file and the screen, uncaught errors included."""

import gc
import json
import logging
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gst.run.chain import (
    LEVELS,
    LOGS,
    Step,
    given_to,
    hashes_of,
    record_of,
    step_of,
    write_record,
)
from gst.run.provenance import software
from gstlib.errors import GstError, InputError, accepting
from gstlib.io.files import cannot_write

# Environment variable, set by the workflow's display of progress, which shows the log's
# messages itself: a job then writes nothing to the screen, unless its log cannot be written.
FILE_ONLY = "GSTLIB_LOG_FILE_ONLY"
# Environment variable with the hash of each step as the run was started, by its results and name.
ASKED = "GSTLIB_STEPS"
# Before the duration in the last line of a step's log.
TOOK = "took "
# Soon after a process began, for scripts import this early.
_START = time.perf_counter()
# Environment variable, set by `gst study --plan`: the display shows the planned jobs, and why.
PLAN = "GSTLIB_PLAN"
# Of the application, and of the library.
_LOGGERS = "gst", "gstlib"
_TRACEBACK = "\nTraceback (most recent call last):\n"
_RECORD = re.compile(
    r"^(\w+) (.*?)(?=^(?:INFO|NOTE|WARNING|ERROR) |\Z)", re.MULTILINE | re.DOTALL
)


class _LogFile(logging.FileHandler):
    """A log file; if the disk is full, warnings go to the screen instead."""

    def __init__(self, path: str | Path, screen: logging.Handler):
        super().__init__(path, mode="w", encoding="utf-8")
        self.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
        self._screen = screen

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        self._screen.setLevel(logging.WARNING)

    def close(self) -> None:
        # if it could not be written, it cannot be flushed either
        with suppress(OSError):
            super().close()


@contextmanager
def job_log(path: str | Path) -> Iterator[logging.Logger]:
    """Log to `path` and to stderr (see `FILE_ONLY`) while the block runs.

    An error meant for the user (`GstError`) ends the process with its message and exit code
    1. Any other error is a bug in the program and keeps its traceback.
    """
    screen = logging.StreamHandler(sys.stderr)
    screen.setFormatter(logging.Formatter("%(levelname)s: %(message)s"))
    screen.setLevel(logging.CRITICAL if FILE_ONLY in os.environ else logging.WARNING)
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        file = _LogFile(path, screen)
    except OSError as error:
        raise SystemExit(f"\nERROR: {cannot_write(path, error)}\n") from None
    log, *_ = levels = {each: each.level for each in map(logging.getLogger, _LOGGERS)}
    for each in levels:
        each.setLevel(logging.INFO)
        each.addHandler(file)  # before the screen, which may have to take its place
        each.addHandler(screen)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, category, *_: log.warning(
                "%s: %s", category.__name__, message
            )
            yield log
    except GstError as error:
        log.error("%s", error)
        raise SystemExit(1) from None
    except Exception as error:
        problem = "unexpected error: this is a bug in the program, please report it"
        if isinstance(error, ImportError):
            missing = "a package that the program needs is missing or broken"
            problem = f"{missing}: install it again ({error})"
        log.exception("%s", problem)
        raise SystemExit(1) from None
    finally:
        for handler in (file, screen):
            for each in levels:
                each.removeHandler(handler)
            handler.close()
        for each, level in levels.items():
            each.setLevel(level)


def logged(log: Path, level: str) -> list[str]:
    """Records of a level in a log of `job_log`; a traceback is cut to its last three lines."""
    shown = []
    for match in _RECORD.finditer(_text_of(log)):
        if match[1] == level:
            message, _, trace = match[2].strip().partition(_TRACEBACK)
            shown.append("\n  ".join([message, *trace.splitlines()[-3:]]))
    return shown


def _text_of(log: Path) -> str:
    return log.read_text("utf-8", "replace") if log.is_file() else ""


def last_took(results: Path, step: str) -> str:
    """How long a step took when it last ran, from its log; empty if that is gone."""
    text = _text_of(results / LOGS / f"{step}.log")
    last = text.rstrip("\n").rpartition("\n")[2]
    return last.partition(TOOK)[2].partition(",")[0]


class _Accepted:
    """The faults that a config accepts; it notes which of them a step asks about."""

    def __init__(self, names: Iterable[str]):
        self.names, self.asked = frozenset(names), dict[str, bool]()

    def __contains__(self, name: object) -> bool:
        return self.asked.setdefault(str(name), name in self.names)


def log_failed_start(snakemake: Any) -> None:
    """Let an error that ends a script before `run_script`, as in an import, stand in its log."""

    def log_it(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        if not issubclass(kind, Exception):  # such as Ctrl-C
            sys.__excepthook__(kind, error, trace)
            return
        with job_log(snakemake.log[0]):
            raise error

    sys.excepthook = log_it


def _refuse_other_params(results: Path, step: Step) -> None:
    """Raise an `InputError` if a step is asked something else than when the run was started."""
    asked = json.loads(os.environ.get(ASKED, "{}"))
    as_begun = asked.get(str(results), {}).get(step.name)
    if as_begun not in (None, hashes_of([step], results)[step.name]):
        problem = (
            "the config, its tables or the program were edited while the study runs"
        )
        remedy = "Start the study again. It repeats the affected steps."
        raise InputError(f"the step {step.name}", problem, remedy)


def run_in_snakemake(main: Callable[..., None]) -> None:
    """Call a script's `main` if Snakemake runs the script; do nothing if a test imports it."""
    snakemake = main.__globals__.get("snakemake")
    if snakemake is not None:
        run_script(snakemake, main)


def run_script(snakemake: Any, main: Callable[..., None]) -> None:
    """Call a script's `main` with the rule's named inputs, outputs and params, all by keyword.

    `snakemake` is the object that Snakemake puts into a script. Files become paths, or lists of
    paths; an empty list stands for an input that the study does not have. The param ``code`` is
    left out: it only shows that the program has changed. The param ``accept`` is a container that
    notes which faults the script asks about.
    """
    log_file = Path(snakemake.log[0])
    results = log_file.parents[1]
    files = {
        name: Path(file) if isinstance(file, str) else [*map(Path, file)]
        for names in (snakemake.input, snakemake.output)
        for name, file in names.items()
    }
    # What was imported stays: to look for garbage among it, the last time when the interpreter
    # ends, takes a quarter of a second.
    gc.freeze()
    accepted = _Accepted(snakemake.config.get("accept", ()))
    settings = dict(snakemake.params)
    settings.pop("code", None)
    if "accept" in settings:
        settings["accept"] = accepted
    step = step_of(log_file, snakemake.params, snakemake.input, snakemake.output)
    with job_log(log_file) as log:
        _refuse_other_params(results, step)
        # of files that are about to change
        record_of(results, step.name).unlink(missing_ok=True)
        ran_on = {"software": software(), "faults": accepted.asked}
        read = given_to(results, step) | ran_on
        with accepting(accepted):
            main(**files, **settings)
        messages = {level: logged(log_file, level) for level in LEVELS}
        write_record(results, step, read, messages)
        log.info("%s", _used())


def _used() -> str:
    """What this process has used so far, exactly; Snakemake's `benchmark` samples it, at a cost."""
    import resource  # Windows has none; there, all but a study may run

    wall_s, cpu_s = time.perf_counter() - _START, time.process_time()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # bytes on macOS
    status = Path("/proc/self/status")
    # Linux: what is above counts the process that started this one, too
    if status.is_file():
        memory = 1024 * int(re.findall(r"VmHWM:\s+(\d+)", status.read_text())[0])
    return (
        f"{TOOK}{wall_s:.2f} s, {cpu_s:.2f} s of CPU, {memory / 1e6:.0f} MB of memory"
    )
