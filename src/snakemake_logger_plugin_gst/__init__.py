"""The display of a run: the logger plugin `gst` of Snakemake, which the profiles name.

It prints a line when a step begins, and when another tenth of the steps is done. Each line begins
with the time since the start. After a minute of silence it shows the progress of the running steps.
Warnings and errors of a step are taken from its log. For `gst study --plan` it lists the steps that
would run, the reasons, and the time that each step last took.

Snakemake's own display is used for its other modes, such as ``--dry-run`` and ``--verbose``. The
plugin `rich` is not used, because it does not show the messages of a step and needs a terminal.
"""

import os
import re
import sys
import threading
import time
from datetime import timedelta
from logging import INFO, LogRecord
from pathlib import Path
from typing import Any

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from gst.run.chain import AGAIN, LEVELS
from gst.run.logs import FILE_ONLY, PLAN, last_took, logged

__all__ = ["LogHandler"]

_SILENT = (
    "the step ended without an error message. It may have lacked time or memory, or a "
    "person may have stopped it."
)
# Snakemake's own messages: those that this display replaces, and those worth a line in a run.
_REPLACED = "At least one job did not complete", "Exiting because a job execution"
_WANTED = "Terminating", "Will exit", "Nothing to be", "Trying to", "Waiting at"
_SILENCE = 60.0  # seconds after which the running steps are shown
# The place in the code at which an error was raised.
_PLACE = r'(?m)^(?:\w+ in (?:rule .*)?file ".*", line \d+:|  File ".*)\n?'


class LogHandler(LogHandlerBase):
    """Shows a run on stderr, and a plan on stdout."""

    writes_to_file = has_formatter = needs_rulegraph = False
    writes_to_stream = has_filter = True

    def __post_init__(self) -> None:
        asked = self.common_settings
        self.is_plan = asked.dryrun and PLAN in os.environ
        other = asked.quiet or asked.verbose or asked.debug_dag or asked.printshellcmds
        self.writes_to_stream = not other and asked.dryrun == self.is_plan
        self.start = self.last_shown = time.time()
        self.total = self.done = self.planned = 0
        self.steps: dict[int, Any] = {}  # that run, by job, as Snakemake announced them
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
                would_run = f"{_steps(self.planned)} would run."
                print(would_run if self.planned else "Nothing to do.")
            elif self.total:
                how = "Finished:" if self.done == self.total else "Stopped with"
                self._print_timed(f"{how} {self.done} of {_steps(self.total)} done.")
                if self.done < self.total:
                    self._print("Repeat the same command to continue from there.")
        super().close()

    def _show(self, record: Any) -> None:  # noqa: C901, a case for each event
        match getattr(record, "event", None):
            case LogEvent.JOB_INFO if record.log:  # not a rule that only names others
                self._plan(record) if self.is_plan else self._begin(record)
            case _ if self.is_plan and record.levelno <= INFO:
                pass
            case LogEvent.RUN_INFO:  # the rule "all" makes nothing
                self.total = record.stats["total"] - record.stats.get("all", 0)
                self._print(f"{_steps(self.total)} to do.")
            case LogEvent.JOB_FINISHED if record.job_id in self.steps:
                self._finish(self.steps.pop(record.job_id))
            case LogEvent.PROGRESS if self.total:
                before, self.done = self.done, min(record.done, self.total)
                if 10 * self.done // self.total > 10 * before // self.total:
                    self._print_timed(f"{self.done} of {self.total} steps done")
            case LogEvent.JOB_ERROR:
                self._fail(self.steps.pop(record.jobid), record.rule_msg)
            case LogEvent.GROUP_ERROR:
                for job in record.job_error_info:
                    self._fail(self.steps.pop(job["jobid"]), record.getMessage())
            case LogEvent.ERROR if "CalledProcessError" not in record.getMessage():
                text = re.sub(_PLACE, "", record.getMessage()).strip()
                self._print(f"ERROR: {text.removeprefix('WorkflowError:').strip()}")
            case None:
                text = record.getMessage()
                if text.startswith(_WANTED) or record.levelno > INFO:
                    self._print(text)

    def _plan(self, step: Any) -> None:
        log, why = Path(step.log[0]), _again(step) or step.reason
        if why.startswith("Missing output files"):
            why = "not made yet"
        elif "updated by another job" in why:
            why = "its inputs are made again"
        took = last_took(log.parents[1], log.stem)
        last = f"; last took {took}" if took else ""
        print(f"{step.rule_name}: {step.rule_msg}\n    {why}{last}")
        self.planned += 1

    def _begin(self, step: Any) -> None:
        self.steps[step.jobid] = step
        Path(step.log[0]).unlink(missing_ok=True)  # of an earlier run
        self._print_timed(step.rule_msg)
        if again := _again(step):
            self._print(f"  again: {again}")

    def _finish(self, step: Any) -> None:
        for level in LEVELS:
            for text in logged(Path(step.log[0]), level):
                self._tell("ACCEPTED FAULT" if level == "ERROR" else level, text, step)

    def _fail(self, step: Any, reason: str) -> None:
        errors = logged(Path(step.log[0]), "ERROR") or [reason or _SILENT]
        self._tell("ERROR", errors[-1], step)

    def _tell(self, level: str, text: str, step: Any) -> None:
        self._print(f"{level}: {text}\n  step: {step.rule_msg}\n  log:  {step.log[0]}")

    def _watch(self) -> None:
        """Show the progress of the running steps after each minute of silence."""
        while not self.ended.wait(1.0):
            if time.time() - self.last_shown > _SILENCE:
                for step in [*self.steps.values()]:
                    minutes = (time.time() - step.created) / 60
                    latest = (logged(Path(step.log[0]), "INFO") or ["working"])[-1]
                    message = f"{step.rule_msg}, for {minutes:.0f} min: {latest}"
                    self._print_timed(message)
                self.last_shown = time.time()

    def _print_timed(self, text: str) -> None:
        elapsed = timedelta(seconds=round(time.time() - self.start))
        self._print(f"{elapsed}  {text}")

    def _print(self, text: str) -> None:
        if not text.removeprefix("ERROR: ").startswith(_REPLACED):
            print(text.rstrip(), file=sys.stderr, flush=True)
            self.last_shown = time.time()


def _steps(count: int) -> str:
    return f"{count} step{'s' * (count != 1)}"


def _again(step: Any) -> str | None:
    """The reason for which the records, or an option with the rule's name, ask for a step again."""
    names = (step.rule_name, *step.output)
    return next((AGAIN[name] for name in names if name in AGAIN), None)
