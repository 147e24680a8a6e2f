"""Snakemake's logger plugin of this project: `logger: gst` in the profile.

Passes what Snakemake tells of a run to `gstlib.progress`, and takes out of its messages what is of
use to who programs the workflow only. Where Snakemake is asked for something else than a run (a
dry run, --verbose, --quiet, ...), its own display does it.
"""

import os
import re
from logging import INFO, LogRecord

from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from gstlib.logs import FILE_ONLY
from gstlib.progress import Progress

__all__ = ["LogHandler"]

# Once this rule has run, the steps of the patches that are studied join the plan.
_CHECKPOINT = "couple_scales"
# Said by the display itself, or of no use to who runs a study.
_SAID_OTHERWISE = (
    "At least one job did not complete successfully",
    "Exiting because a job execution failed",
)
_STOPPED = ("Terminating", "Will exit")
_WANTED_IN_A_RUN = (*_STOPPED, "Trying to restart", "Waiting at most")
_NOISE = ("Assuming", "Building DAG", "Config file", "Updating", "Using shell")
_RAISED = re.compile(r"Error:\n  \w+: (.*?)\nWildcards:\n.*", re.DOTALL)  # in an input function
_PLACE = re.compile(r'^(?:\w+ in (?:rule .*)?file ".*", line \d+:|  File ".*)\n?', re.MULTILINE)


class LogHandler(LogHandlerBase):
    """Shows a run as `gstlib.progress` does."""

    def __post_init__(self) -> None:
        asked = self.common_settings
        self.idle = bool(
            asked.dryrun or asked.quiet or asked.verbose or asked.debug_dag or asked.printshellcmds
        )
        if not self.idle:
            os.environ[FILE_ONLY] = "1"  # the jobs'
            self.progress = Progress()

    writes_to_file = has_formatter = needs_rulegraph = False
    has_filter = True

    @property
    def writes_to_stream(self) -> bool:
        return not self.idle

    def emit(self, record: LogRecord) -> None:
        if self.idle:
            return
        try:
            self._show(record)
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        if not self.idle:
            self.progress.close()
        super().close()

    def _show(self, record: LogRecord) -> None:
        show = self.progress
        match getattr(record, "event", None):
            case LogEvent.RUN_INFO:
                if not show.total:
                    stats = record.stats
                    show.plan(stats["total"], growing=_CHECKPOINT in stats)
            case LogEvent.JOB_INFO:
                if record.output:  # not a rule that only names others
                    what = record.rule_msg or record.rule_name
                    show.begin(record.jobid, what, next(iter(record.log), None))
            case LogEvent.JOB_FINISHED:
                show.end(record.job_id)
            case LogEvent.PROGRESS:
                show.count(record.done, record.total)
            case LogEvent.JOB_ERROR:
                show.fail(record.jobid, record.rule_name, record.log, record.rule_msg)
            case LogEvent.GROUP_ERROR:
                for job in record.job_error_info:
                    show.fail(job["jobid"], job["rule_name"], job["log"], record.getMessage())
            case LogEvent.ERROR:
                self._explain(record)
            case None if self._wanted(record):
                show.write(record.getMessage())

    def _wanted(self, record: LogRecord) -> bool:
        text = record.getMessage()
        self.progress.stopped |= text.startswith(_STOPPED)
        if record.levelno > INFO:
            return not text.startswith(_SAID_OTHERWISE)
        if self.progress.total:
            return text.startswith(_WANTED_IN_A_RUN)
        return not text.startswith(_NOISE)

    def _explain(self, record: LogRecord) -> None:
        """An error of Snakemake's or of the config, without where in the program it was found."""
        text = record.getMessage()
        if "CalledProcessError" in text and record.exception == "RuleException":
            return  # of a script: its log says more, see JOB_ERROR
        text = _PLACE.sub("", text).strip().removeprefix("WorkflowError:\n")
        text = _RAISED.sub(r"\1", text)
        self.progress.stopped = True
        if not text.startswith(_SAID_OTHERWISE):
            self.progress.write(f"ERROR: {text}")
        if "not valid JSON or YAML" in text:
            self.progress.write("`make check` with the same config says in which line.")
