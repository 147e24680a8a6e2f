"""The log of a job, and what the display of a run takes from it."""

import logging
import re
import warnings
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

import snakemake_logger_plugin_gst as plugin
from gst.run.logs import FILE_ONLY, job_log, logged
from gstlib.errors import NOTE, InputError
from snakemake_logger_plugin_gst import _SILENT, LogHandler

EMPTY = InputError("scan.plu", "is empty", "Copy it again.")


def test_an_error_of_the_user_is_one_line_and_a_bug_in_the_program_a_traceback(
    tmp_path, capsys
):
    log = tmp_path / "logs/job.log"
    with pytest.raises(SystemExit) as ended, job_log(log):
        raise EMPTY
    assert ended.value.code == 1
    assert capsys.readouterr().err == f"ERROR: {EMPTY}\n"
    assert log.read_text() == f"ERROR {EMPTY}\n"
    with pytest.raises(SystemExit), job_log(log):
        raise ZeroDivisionError("oops")
    assert "Traceback" in capsys.readouterr().err
    (shown,) = logged(log, "ERROR")
    assert "Traceback" not in shown
    assert "ZeroDivisionError: oops" in shown


def test_messages_of_every_level_are_read_back_whole(tmp_path, capsys):
    levels = {"ERROR": logging.ERROR, "WARNING": logging.WARNING, "NOTE": NOTE}
    with job_log(tmp_path / "job.log") as log:
        for level, number in levels.items():
            log.log(number, "%s: a patch\n  and another line", level)
        logging.getLogger("gstlib.anything").info("step 1")
        warnings.warn("contact at the border", UserWarning, stacklevel=1)
    for level in levels:
        first, *others = logged(tmp_path / "job.log", level)
        assert first == f"{level}: a patch\n  and another line"
        assert others == ["UserWarning: contact at the border"] * (level == "WARNING")
    assert logged(tmp_path / "job.log", "INFO") == ["step 1"]
    assert "contact at the border" in capsys.readouterr().err


class Run:
    """Snakemake's messages to the display, and what that shows."""

    def __init__(self, total):
        names = ("quiet", "verbose", "debug_dag", "printshellcmds", "dryrun")
        self.handler = LogHandler(SimpleNamespace(**dict.fromkeys(names, False)), None)
        self.total = total
        self.tell(LogEvent.RUN_INFO, stats={"total": total + 1, "all": 1})

    def tell(self, event, text="", **facts):
        record = logging.LogRecord("snakemake", logging.INFO, "", 0, text, None, None)
        record.__dict__ |= {"event": event} | facts
        self.handler.handle(record)

    def begin(self, job, log="none.log"):
        facts = {"rule_msg": f"Pressing patch {job}", "rule_name": "solve_patches"}
        self.tell(LogEvent.JOB_INFO, jobid=job, log=[str(log)], output=["a"], **facts)

    def end(self, job):
        self.tell(LogEvent.JOB_FINISHED, job_id=job)
        self.tell(LogEvent.PROGRESS, done=job, total=self.total + 1)


@pytest.fixture
def shown(monkeypatch, capsys):
    """What the display shows."""
    monkeypatch.setenv(FILE_ONLY, "")  # restored afterwards: the display sets it
    return lambda: capsys.readouterr().err


def test_the_display_counts_the_steps_and_shows_the_time_since_the_start(
    shown, monkeypatch
):
    run = Run(40)
    monkeypatch.setattr(plugin.time, "time", lambda: run.handler.start + 300)
    for job in range(1, 41):
        run.begin(job)
        run.end(job)
    run.end(41)  # the rule that only names the others
    run.handler.close()
    text = shown()
    assert text.startswith("40 steps to do.\n0:05:00  Pressing patch 1\n")
    steps = re.findall(r"0:05:00  (\d+) of 40 steps done\n", text)
    assert steps == [str(done) for done in range(4, 41, 4)]
    assert "Finished" in text.splitlines()[-1]


def test_the_display_shows_warnings_and_the_error_of_a_failed_step_once(
    shown, tmp_path
):
    log = tmp_path / "job.log"
    log.write_text("WARNING of yesterday\nERROR of yesterday\n")
    run = Run(4)
    run.begin(1, log)
    with job_log(log) as job:
        job.warning("patch 2 was not found\nsee the map")
    run.end(1)
    run.begin(2, log)
    with pytest.raises(SystemExit), job_log(log):
        raise EMPTY
    run.tell(LogEvent.JOB_ERROR, jobid=2, rule_msg=None)
    run.begin(3, log)
    # killed before it wrote anything
    run.tell(LogEvent.JOB_ERROR, jobid=3, rule_msg=None)
    run.handler.close()
    text, place = shown(), f"\n  step: Pressing patch %d\n  log:  {log}\n"
    assert "yesterday" not in text
    assert f"WARNING: patch 2 was not found\nsee the map{place % 1}" in text
    assert f"ERROR: {EMPTY}{place % 2}" in text
    assert f"ERROR: {_SILENT}{place % 3}" in text
    assert "Stopped with 1 of 4 steps done" in text.splitlines()[-2]
