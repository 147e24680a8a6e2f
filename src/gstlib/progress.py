"""What a person sees of a run: how far it is, what goes on now, how long it still takes.

Knows nothing of Snakemake, whose plugin `snakemake_logger_plugin_gst` tells it what happens. In a
terminal: a line for each step that has ended, and a last line that is always renewed. Elsewhere: a
line for each tenth of the steps, no control characters. What a step warned of, or why it failed, is
taken from its log, wherever the step ran.
"""

import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TextIO

__all__ = ["Progress", "duration", "error_in", "warnings_in"]

# As `gstlib.logs` writes them; lines without a level belong to what stands above them.
_RECORD = re.compile(r"^(?:DEBUG|INFO|WARNING|ERROR) ", re.MULTILINE)
# The place of a fault in the program, and what was wrong.
_TRACEBACK_END = 3
_SILENT = (
    "the step ended without saying why. It may have been stopped: by somebody, at its time limit, "
    "or for want of memory."
)
# Fewer steps say nothing of the others.
_STEPS_TO_JUDGE_BY = 3
_NEW_LINE, _CLEAR = "\r", "\x1b[K"


def duration(seconds: float) -> str:
    """A time as people say it.

    >>> duration(7.4), duration(200), duration(7500)
    ('7 s', '3 min 20 s', '2 h 05 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _records(text: str, level: str) -> list[str]:
    starts = [match.start() for match in _RECORD.finditer(text)]
    parts = [text[start:end] for start, end in pairwise([*starts, len(text)])]
    return [part.removeprefix(level).strip() for part in parts if part.startswith(f"{level} ")]


def warnings_in(log: str) -> list[str]:
    """What a job's log warns of."""
    return _records(log, "WARNING")


def error_in(log: str) -> str | None:
    """Why a job failed, from its log: its own words, or the end of the traceback of a fault."""
    errors = _records(log, "ERROR")
    if not errors:
        return None
    said, traceback, frames = errors[-1].partition("\nTraceback (most recent call last):\n")
    if not traceback:
        return said
    end = frames.strip("\n").splitlines()[-_TRACEBACK_END:]
    return "\n".join([said, *(f"  {line}" for line in end)])


@dataclass
class _Step:
    what: str
    log: Path | None
    before: tuple[int, int] | None  # state of a log that an earlier run may have left
    start: float

    def said(self) -> str:
        """What this run wrote to the step's log."""
        if self.log is None or _state(self.log) in (None, self.before):
            return ""
        return self.log.read_text(encoding="utf-8", errors="replace")


def _state(file: Path | None) -> tuple[int, int] | None:
    try:
        status = file.stat()
    except (OSError, AttributeError):
        return None
    return status.st_mtime_ns, status.st_size


@dataclass
class Progress:
    """The steps of a run, shown as they go.

    Parameters
    ----------
    stream : text stream
        Where to; a terminal gets the renewed line.
    clock : callable
        Seconds.

    Attributes
    ----------
    done, total : int
        Steps done, and known.
    growing : bool
        Whether more steps are to come that are not known yet.
    stopped : bool
        Whether the run ends before its end: a step failed, somebody stopped it, ...
    """

    stream: TextIO = field(default_factory=lambda: sys.stderr)
    clock: Callable[[], float] = time.monotonic
    done: int = 0
    total: int = 0
    growing: bool = False
    stopped: bool = False

    def __post_init__(self) -> None:
        self._start = self.clock()
        self._running: dict[int, _Step] = {}
        self._tenth = 0
        self._lock = threading.RLock()
        self._ended = threading.Event()
        self.live = self.stream.isatty()

    def plan(self, total: int, *, growing: bool) -> None:
        """The run has `total` steps, and more to come that are not yet known if it is `growing`."""
        self.total, self.growing = total, growing
        noun = "step" if total == 1 else "steps"
        more = ", and more for the patches that turn out to be studied" if growing else ""
        self.write(f"{total} {noun} to do{more}.")
        if self.live:
            threading.Thread(target=self._tick, daemon=True).start()

    def begin(self, job: int, what: str, log: str | None = None) -> None:
        """A step begins; its `log` tells later how it went."""
        path = None if log is None else Path(log)
        with self._lock:
            self._running[job] = _Step(what, path, _state(path), self.clock())
            self._renew()

    def end(self, job: int) -> None:
        """A step has ended well."""
        with self._lock:
            step = self._running.pop(job, None)
            if step is not None:
                self.done += 1
                for text in warnings_in(step.said()):
                    self.write(f"WARNING: {text}\n  step: {step.what}\n  log:  {step.log}")
                if self.live:
                    took = duration(self.clock() - step.start)
                    self.write(f"{self._count(self.done):>12} {took:>12}  {step.what}")

    def count(self, done: int, total: int) -> None:
        """So many steps are done, of so many that are known now."""
        with self._lock:
            if total > self.total:  # what was to come is known
                self.growing, self._tenth = False, 10 * done // total
            self.done, self.total = done, total
            if not self.live and 10 * done // total > self._tenth:
                self._tenth = 10 * done // total
                self.write(self.summary())
            self._renew()

    def fail(
        self, job: int, what: str, logs: Sequence[str] = (), reason: str | None = None
    ) -> None:
        """A step has failed; `reason` is what is known of it besides its log."""
        with self._lock:
            self.stopped = True
            step = self._running.pop(job, None)
            said = error_in(step.said()) if step is not None else None
            self.write(f"\nERROR: {said or reason or _SILENT}")
            self.write(f"  step: {step.what if step else what}")
            self.write("".join(f"  log:  {log}\n" for log in logs))
            if self._running:
                self.write("Waiting for what else is running to end.")

    def close(self) -> None:
        """The run is over."""
        with self._lock:
            if not self.total or self._ended.is_set():
                return
            self._ended.set()
            took = duration(self.clock() - self._start)
            if self.stopped:
                self.write(
                    f"Stopped after {took} with {self._count(self.done)} steps done: "
                    "the same command goes on from there."
                )
            else:  # some of the steps may have turned out not to be needed
                noun = "step" if self.done == 1 else "steps"
                self.write(f"All is done: {self.done} {noun} in {took}.")

    def summary(self) -> str:
        """How far, how long, how long still, and what goes on now."""
        elapsed = self.clock() - self._start
        text = f"{self._count(self.done)} steps done, {duration(elapsed)}"
        if not self.growing and _STEPS_TO_JUDGE_BY <= self.done < self.total:
            left = elapsed / self.done * (self.total - self.done)
            text += f", about {duration(left)} left"
        now = "; ".join(step.what for step in self._running.values())
        return f"{text}. Now: {now}" if now else text

    def write(self, text: str) -> None:
        """Whole lines, above the one that is renewed."""
        with self._lock:
            start = _NEW_LINE + _CLEAR if self.live else ""
            self.stream.write(f"{start}{text.rstrip()}\n")
            self._renew()
            self.stream.flush()

    def _count(self, done: int) -> str:
        return f"{done} of {self.total}{'+' if self.growing else ''}"

    def _renew(self) -> None:
        if self.live and self.total and not self._ended.is_set():
            width = shutil.get_terminal_size().columns - 1
            self.stream.write(f"{_NEW_LINE}{_CLEAR}{self.summary()[:width]}")
            self.stream.flush()

    def _tick(self) -> None:
        while not self._ended.wait(1.0):
            with self._lock:
                self._renew()
