"""Snakemake's logger plugin of this project (`logger: gst` in the profile): shows progress.

It prints a line when a step begins, and, with the time that is left, when another tenth of the
steps is done. After a minute of silence it shows how far the running steps are. A step's warnings
and errors come from its log. For `gst study --plan` it shows what would run, why, and how long that
last took. If Snakemake is asked for anything else (--dry-run, --verbose, ...), its own display is
used.
"""

import os
import re
import sys
import threading
import time
from datetime import timedelta
from graphlib import TopologicalSorter
from logging import INFO, LogRecord
from pathlib import Path
from typing import Any

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from gst.run.chain import AGAIN, LEVELS
from gst.run.logs import FILE_ONLY, PLAN, last_took, logged

__all__ = ["LogHandler"]

_SILENT = (
    "the step ended without an error message. It may have been stopped: by a person, at its time "
    "limit, or for lack of memory."
)
# Snakemake's own messages: those that this display replaces, and those worth a line in a run.
_REPLACED = (
    "At least one job did not complete successfully",
    "Exiting because a job execution",
)
_WANTED = ("Terminating", "Will exit", "Nothing to be", "Trying to restart", "Waiting at most")
# Seconds of CPU that a job of a rule takes in the default study, as its log says; a second for
# all others. Only their ratios matter: the run itself shows how fast this machine is.
_COSTS = {
    "generate_specimen": 40,
    "infer_use": 18,
    "solve_reference": 17,
    "bound_pressures": 16,
    "solve_patches": 10,
    "predict_wear": 9,
    "draw_validation": 9,
    "draw_contact": 7,
    "write_page": 6,
    "draw_inputs": 6,
    "register_patches": 6,
    "tabulate_texture": 6,
    "solve_cases": 5,
    "score_wear": 5,
    "grid_macroscale": 5,
    "prepare_scans": 3,
    "compare_scales": 3,
    "compose_surface": 3,
    "solve_macroscale": 2,
}
_SILENCE = 60.0  # seconds after which the running steps are shown
_PLACE = re.compile(r'^(?:\w+ in (?:rule .*)?file ".*", line \d+:|  File ".*)\n?', re.MULTILINE)


class LogHandler(LogHandlerBase):
    """Shows a run on stderr."""

    writes_to_file = has_formatter = needs_rulegraph = False
    writes_to_stream = has_filter = True

    def __post_init__(self) -> None:
        asked = self.common_settings
        self.is_plan = asked.dryrun and PLAN in os.environ
        other = asked.quiet or asked.verbose or asked.debug_dag or asked.printshellcmds
        self.writes_to_stream = not other and asked.dryrun == self.is_plan
        self.start, self.total, self.done = time.monotonic(), 0, 0
        self.is_closed = False
        self.steps: dict[int, tuple[str, Path]] = {}  # what each does, and its log
        self.begun: dict[int, tuple[str, float]] = {}  # by job, its rule and when it began
        # by job, what to say of it, and its record
        self.planned: dict[int, tuple[str, Any]] = {}
        self.to_do = self.cost_done = 0.0
        self.said_last, self.ended = self.start, threading.Event()
        if self.writes_to_stream:
            os.environ[FILE_ONLY] = "1"  # for the steps, which inherit it
            threading.Thread(target=self._watch, daemon=True).start()

    def emit(self, record: LogRecord) -> None:
        try:
            if self.writes_to_stream:
                self._show(record)
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        self.ended.set()
        if not self.is_closed:  # Snakemake closes its handlers more than once
            self._end()
        self.is_closed = True
        super().close()

    def _end(self) -> None:
        if self.is_plan:
            print(*self._plan(), sep="\n")
        elif self.done < self.total:
            how_far = f"{self.done} of {self.total} steps done, after {self._elapsed()}"
            self._say(
                f"Stopped with {how_far}. Repeat the same command to continue from there."
            )
        elif self.total:
            are = f"All {_steps(self.done)} are" if self.done > 1 else "The step is"
            self._say(f"{are} done, after {self._elapsed()}.")

    def _show(self, record: Any) -> None:  # noqa: C901, a case for each event
        match getattr(record, "event", None):
            case LogEvent.JOB_INFO if record.log:  # not a rule that only names others
                self._begin(record)
            case _ if self.is_plan and record.levelno <= INFO:
                pass
            case LogEvent.RUN_INFO:
                counts = dict(record.stats)
                counts.pop("all", None)  # it makes nothing
                counts.pop("total")
                self.total = sum(counts.values())
                self.to_do = sum(_COSTS.get(rule, 1) * n for rule, n in counts.items())
                self._say(f"{_steps(self.total)} to do.")
            case LogEvent.JOB_FINISHED if record.job_id in self.steps:
                rule, _ = self.begun.pop(record.job_id)
                self.cost_done += _COSTS.get(rule, 1)
                what, log = self.steps[record.job_id]
                for level, text in ((of, text) for of in LEVELS for text in logged(log, of)):
                    name = "ACCEPTED FAULT" if level == "ERROR" else level
                    self._say(f"{name}: {text}\n  step: {what}\n  log:  {log}")
            case LogEvent.PROGRESS:
                done = min(record.done, self.total)  # without "all"
                if self.total and 10 * done // self.total > 10 * self.done // self.total:
                    left = self._left() if done < self.total else ""
                    self._say(f"{self._elapsed()}  {done} of {self.total} steps done{left}")
                self.done = done
            case LogEvent.JOB_ERROR:
                self._fail(record.jobid, record.rule_msg or _SILENT)
            case LogEvent.GROUP_ERROR:
                for job in record.job_error_info:
                    self._fail(job["jobid"], record.getMessage() or _SILENT)
            case LogEvent.ERROR:
                text = record.getMessage()
                if "CalledProcessError" not in text:  # of a step; its own log says more
                    text = _PLACE.sub("", text).strip().removeprefix("WorkflowError:\n")
                    self._say(f"ERROR: {text}")
            case None:
                text = record.getMessage()
                if text.startswith(_WANTED) or record.levelno > INFO:
                    self._say(text)

    def _begin(self, record: Any) -> None:
        """A step that begins; or that would run, why, and how long it last took."""
        what, log = record.rule_msg or record.rule_name, Path(record.log[0])
        self.steps[record.jobid] = what, log
        self.begun[record.jobid] = record.rule_name, time.monotonic()
        # as the records say, or as was asked for by the rule's name
        asked = (record.rule_name, *record.output)
        again = next((AGAIN[name] for name in asked if name in AGAIN), None)
        if self.is_plan:
            took = last_took(log.parents[1], log.stem)
            why = (again or _why(record.reason)) + (f"; last took {took}" if took else "")
            self.planned[record.jobid] = f"{record.rule_name}: {what}\n    {why}", record
            return
        log.unlink(missing_ok=True)  # of an earlier run
        self._say(f"{self._elapsed()}  {what}")
        if again:
            self._say(f"  again: {again}")

    def _plan(self) -> list[str]:
        """The steps in an order in which they could run, the same each time; and their number."""
        if not self.planned:
            return ["Nothing to do."]
        makes = {file: job for job, (_, of) in self.planned.items() for file in of.output}
        needs = {
            job: {makes[file] for file in of.input if file in makes}
            for job, (_, of) in self.planned.items()
        }
        sorter = TopologicalSorter(needs)
        sorter.prepare()
        lines: list[str] = []
        while sorter.is_active():
            ready = sorter.get_ready()
            lines += sorted(self.planned[job][0] for job in ready)
            sorter.done(*ready)
        return [*lines, f"{_steps(len(self.planned))} would run."]

    def _left(self) -> str:
        """About how long the rest takes, at the pace so far."""
        if not 0 < self.cost_done < self.to_do:
            return ""
        pace = (time.monotonic() - self.start) / self.cost_done
        minutes = pace * (self.to_do - self.cost_done) / 60
        return (
            f", about {minutes:.0f} min left" if minutes >= 1 else ", less than a minute left"
        )

    def _watch(self) -> None:
        """After a minute of silence, and each one that follows, show how far the steps are."""
        while not self.ended.wait(1.0):
            if time.monotonic() - self.said_last > _SILENCE:
                for job, (_, begun) in list(self.begun.items()):
                    what, log = self.steps[job]
                    minutes = (time.monotonic() - begun) / 60
                    latest = (logged(log, "INFO") or ["working"])[-1].partition("\n")[0]
                    self._say(f"{self._elapsed()}  {what}, for {minutes:.0f} min: {latest}")
                self.said_last = time.monotonic()

    def _fail(self, job: int, reason: str) -> None:
        self.begun.pop(job, None)
        what, log = self.steps[job]
        error = (logged(log, "ERROR") or [reason])[-1]
        self._say(f"ERROR: {error}\n  step: {what}\n  log:  {log}")

    def _say(self, text: str) -> None:
        if not text.removeprefix("ERROR: ").startswith(_REPLACED):
            print(text.rstrip(), file=sys.stderr, flush=True)
            self.said_last = time.monotonic()

    def _elapsed(self) -> str:
        return str(timedelta(seconds=round(time.monotonic() - self.start)))


def _steps(count: int) -> str:
    return f"{count} step{'s' * (count != 1)}"


def _why(reason: str) -> str:
    """A reason of Snakemake in our words."""
    if reason.startswith("Missing output files"):
        return "not made yet"
    return "its inputs are made again" if "updated by another job" in reason else reason
