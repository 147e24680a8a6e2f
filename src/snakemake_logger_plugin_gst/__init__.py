"""Snakemake's logger plugin of this project (`logger: gst` in the profile): shows progress.

It prints a line when a step begins, and when another tenth of the steps is done. Each line begins
with the time since the start. The time left is not estimated, because the steps of two studies
differ too much. After a minute of silence it shows how far the running steps are. A step's warnings
and errors come from its log. For `gst study --plan` it shows what would run, why, and how long that
last took. If Snakemake is asked for anything else (--dry-run, --verbose, ...), its own display is
used. The plugin `rich` does not show the messages of a step, and it needs a terminal.
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
_WANTED = (
    "Terminating",
    "Will exit",
    "Nothing to be",
    "Trying to restart",
    "Waiting at most",
)
_SILENCE = 60.0  # seconds after which the running steps are shown
_PLACE = re.compile(
    r'^(?:\w+ in (?:rule .*)?file ".*", line \d+:|  File ".*)\n?', re.MULTILINE
)


class LogHandler(LogHandlerBase):
    """Shows a run on stderr."""

    writes_to_file = has_formatter = needs_rulegraph = False
    writes_to_stream = has_filter = True

    def __post_init__(self) -> None:
        asked = self.common_settings
        self.is_plan = asked.dryrun and PLAN in os.environ
        other = asked.quiet or asked.verbose or asked.debug_dag or asked.printshellcmds
        self.writes_to_stream = not other and asked.dryrun == self.is_plan
        self.start = self.last_shown = time.time()
        self.total = self.done = 0
        self.steps: dict[int, Any] = {}  # by job, how Snakemake announced it
        self.running: set[int] = set()
        self.planned: dict[str, Any] = {}  # by the text of the plan, likewise
        self.ended = threading.Event()
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
        if not self.ended.is_set():  # Snakemake closes its handlers more than once
            self.ended.set()
            if self.is_plan:
                print(*self._plan(), sep="\n")
            elif self.total:
                done = f"{self.done} of {_steps(self.total)} done, after {self._elapsed()}."
                again = " Repeat the same command to continue from there."
                is_whole = self.done == self.total
                self._print(
                    f"Finished: {done}" if is_whole else f"Stopped with {done}{again}"
                )
        super().close()

    def _show(self, record: Any) -> None:  # noqa: C901, a case for each event
        match getattr(record, "event", None):
            case LogEvent.JOB_INFO if record.log:  # not a rule that only names others
                self._begin(record)
            case _ if self.is_plan and record.levelno <= INFO:
                pass
            case LogEvent.RUN_INFO:
                counts = {
                    rule: count
                    for rule, count in record.stats.items()
                    if rule not in ("all", "total")  # the rule "all" makes nothing
                }
                self.total = sum(counts.values())
                self._print(f"{_steps(self.total)} to do.")
            case LogEvent.JOB_FINISHED if record.job_id in self.steps:
                self._finish(record.job_id)
            case LogEvent.PROGRESS:
                before, self.done = (
                    self.done,
                    min(record.done, self.total),
                )  # without "all"
                if (
                    self.total
                    and 10 * self.done // self.total > 10 * before // self.total
                ):
                    progress = f"{self.done} of {self.total} steps done"
                    self._print(f"{self._elapsed()}  {progress}")
            case LogEvent.JOB_ERROR:
                self._fail(record.jobid, record.rule_msg)
            case LogEvent.GROUP_ERROR:
                for job in record.job_error_info:
                    self._fail(job["jobid"], record.getMessage())
            case LogEvent.ERROR:
                text = record.getMessage()
                if "CalledProcessError" not in text:  # of a step; its own log says more
                    text = _PLACE.sub("", text).strip().removeprefix("WorkflowError:\n")
                    self._print(f"ERROR: {text}")
            case None:
                text = record.getMessage()
                if text.startswith(_WANTED) or record.levelno > INFO:
                    self._print(text)

    def _begin(self, step: Any) -> None:
        """Show a step that begins; or keep it, if it only would run, for the plan."""
        # as the records say, or as was asked for by the rule's name
        names = (step.rule_name, *step.output)
        again = next((AGAIN[name] for name in names if name in AGAIN), None)
        log = Path(step.log[0])
        if self.is_plan:
            took = last_took(log.parents[1], log.stem)
            why = (again or _why(step.reason)) + (f"; last took {took}" if took else "")
            self.planned[f"{step.rule_name}: {_message(step)}\n    {why}"] = step
            return
        self.steps[step.jobid] = step
        self.running.add(step.jobid)
        log.unlink(missing_ok=True)  # of an earlier run
        self._print(f"{self._elapsed()}  {_message(step)}")
        if again:
            self._print(f"  again: {again}")

    def _finish(self, job: int) -> None:
        self.running.discard(job)
        for level in LEVELS:
            for text in logged(Path(self.steps[job].log[0]), level):
                self._tell("ACCEPTED FAULT" if level == "ERROR" else level, text, job)

    def _fail(self, job: int, reason: str) -> None:
        self.running.discard(job)
        errors = logged(Path(self.steps[job].log[0]), "ERROR") or [reason or _SILENT]
        self._tell("ERROR", errors[-1], job)

    def _plan(self) -> list[str]:
        """The steps in an order in which they could run, the same each time; and their number."""
        steps = sorted(self.planned.items(), key=lambda step: step[0])
        makers = {file: text for text, record in steps for file in record.output}
        needs = {
            text: sorted({makers[file] for file in record.input if file in makers})
            for text, record in steps
        }
        order = TopologicalSorter(needs).static_order()
        return (
            [*order, f"{_steps(len(steps))} would run."]
            if steps
            else ["Nothing to do."]
        )

    def _watch(self) -> None:
        """After a minute of silence, and each one that follows, show how far the steps are."""
        while not self.ended.wait(1.0):
            if time.time() - self.last_shown > _SILENCE:
                for step in [self.steps[job] for job in list(self.running)]:
                    minutes = (time.time() - step.created) / 60
                    latest = (logged(Path(step.log[0]), "INFO") or ["working"])[-1]
                    progress = f"{_message(step)}, for {minutes:.0f} min: {latest}"
                    self._print(f"{self._elapsed()}  {progress}")
                self.last_shown = time.time()

    def _tell(self, level: str, text: str, job: int) -> None:
        step = self.steps[job]
        self._print(f"{level}: {text}\n  step: {_message(step)}\n  log:  {step.log[0]}")

    def _print(self, text: str) -> None:
        if not text.removeprefix("ERROR: ").startswith(_REPLACED):
            print(text.rstrip(), file=sys.stderr, flush=True)
            self.last_shown = time.time()

    def _elapsed(self) -> str:
        return str(timedelta(seconds=round(time.time() - self.start)))


def _steps(count: int) -> str:
    return f"{count} step{'s' * (count != 1)}"


def _message(step: Any) -> str:
    return step.rule_msg or step.rule_name


def _why(reason: str) -> str:
    """A reason of Snakemake in our words."""
    if reason.startswith("Missing output files"):
        return "not made yet"
    return "its inputs are made again" if "updated by another job" in reason else reason
