"""The log of a job, and what the display of a run takes from it."""

import logging
import re
import subprocess
import sys
import time
import warnings
from itertools import permutations
from types import SimpleNamespace

import pytest
import snakemake_logger_plugin_gst as plugin
from gst.run.logs import FILE_ONLY, PLAN, job_log, logged
from gstlib.errors import NOTE, InputError
from snakemake_interface_logger_plugins.common import LogEvent
from snakemake_logger_plugin_gst import _SILENT, LogHandler

EMPTY = InputError("scan.plu", "is empty", "Copy it again.")


def test_an_error_of_the_user_is_one_line_and_a_bug_in_the_program_a_traceback(tmp_path, capsys):
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


@pytest.mark.parametrize("line", ["import no_such", "1 / 0"])
def test_an_error_before_the_start_of_a_script_stands_in_its_log(tmp_path, line):
    log = tmp_path / "job.log"
    start = "from types import SimpleNamespace\nfrom gst.run.logs import log_failed_start\n"
    start += f"log_failed_start(SimpleNamespace(log=[{str(log)!r}]))\n"
    ended = subprocess.run([sys.executable, "-c", start + line], check=False)
    assert ended.returncode == 1
    (shown,) = logged(log, "ERROR")
    assert ("install" in shown) == ("no_such" in shown) == ("no_such" in line)


def test_messages_of_every_level_are_read_back_whole(tmp_path, capsys):
    levels = {"ERROR": logging.ERROR, "WARNING": logging.WARNING, "NOTE": NOTE}
    for first, second in permutations(levels, 2):
        with job_log(tmp_path / "job.log") as log:
            for level in (first, second):
                log.log(levels[level], "%s: a patch\n  and another line", level.lower())
        for level in levels:
            expected = [f"{level.lower()}: a patch\n  and another line"]
            messages = logged(tmp_path / "job.log", level)
            assert messages == (expected if level in (first, second) else [])
    before = logging.getLogger("gstlib").level
    with job_log(tmp_path / "job.log"):
        logging.getLogger("gstlib.anything").info("step 1")
        warnings.warn("contact at the border", UserWarning, stacklevel=1)
    assert logged(tmp_path / "job.log", "INFO") == ["step 1"]
    assert logged(tmp_path / "job.log", "WARNING") == ["UserWarning: contact at the border"]
    assert "contact at the border" in capsys.readouterr().err
    assert logging.getLogger("gstlib").level == before


class Run:
    """Snakemake's messages to the display, and what that shows."""

    def __init__(self, total, *, dryrun=False):
        asked = dict.fromkeys(("quiet", "verbose", "debug_dag", "printshellcmds"), False)
        self.handler = LogHandler(SimpleNamespace(dryrun=dryrun, **asked), None)
        self.total = total
        self.tell(LogEvent.RUN_INFO, stats={"total": total + 1, "all": 1, "solve_patches": total})

    def tell(self, event, text="", level=logging.INFO, **facts):
        record = logging.LogRecord("snakemake", level, "", 0, text, None, None)
        record.__dict__ |= {"event": event} | facts
        self.handler.handle(record)

    def begin(self, job, log="none.log"):
        facts = {"rule_msg": f"Pressing patch {job}", "rule_name": "solve_patches"}
        self.tell(LogEvent.JOB_INFO, jobid=job, log=[str(log)], output=["a"], **facts)

    def end(self, job):
        self.tell(LogEvent.JOB_FINISHED, job_id=job)
        self.tell(LogEvent.PROGRESS, done=job, total=self.total + 1)

    def fail(self, job):
        self.tell(LogEvent.JOB_ERROR, jobid=job, rule_name="solve_patches", rule_msg=None, log=[])


@pytest.fixture
def shown(monkeypatch, capsys):
    """What the display shows."""
    monkeypatch.setenv(FILE_ONLY, "")  # restored afterwards: the display sets it
    return lambda: capsys.readouterr().err


def test_the_display_counts_the_steps_and_tells_the_time_that_is_left(shown, monkeypatch):
    run = Run(40)
    monkeypatch.setattr(plugin.time, "time", lambda: run.handler.start + 300)
    for job in range(1, 41):
        run.begin(job)
        run.end(job)
    run.end(41)  # the rule that only names the others
    run.handler.close()
    text = shown()
    assert text.startswith("40 steps to do.\n0:05:00  Pressing patch 1\n")
    steps = re.findall(r"(\d+) of 40 steps done(?:, about (\d+) min left)?\n", text)
    # a tenth of the work took five minutes, then a fifth, ...
    minutes = ["45", "20", "12", "8", "5", "3", "2", "1", "", ""]
    assert steps[:8] == [(str(4 * n), left) for n, left in enumerate(minutes[:8], 1)]
    assert "36 of 40 steps done, less than a minute left\n" in text
    assert "40 of 40 steps done\n" in text
    assert "Finished" in text.splitlines()[-1]
    assert not re.search(r"[^\x20-\x7e\n]", text)


def test_the_display_shows_warnings_and_the_error_of_a_failed_step_once(shown, tmp_path):
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
    run.fail(2)
    run.begin(3, log)
    run.fail(3)  # killed before it wrote anything
    run.handler.close()
    text, place = shown(), f"\n  step: Pressing patch %d\n  log:  {log}\n"
    assert "yesterday" not in text
    assert f"WARNING: patch 2 was not found\nsee the map{place % 1}" in text
    assert f"ERROR: {EMPTY}{place % 2}" in text
    assert f"ERROR: {_SILENT}{place % 3}" in text
    assert text.count(EMPTY.problem) == 1
    assert "Stopped with 1 of 4 steps done" in text.splitlines()[-1]


def test_silence_ends_with_how_far_the_running_steps_are(shown, monkeypatch, tmp_path):
    monkeypatch.setattr(plugin, "_SILENCE", 0.0)
    run, log = Run(4), tmp_path / "job.log"
    run.begin(1, log)
    log.write_text("INFO patch 3\nINFO patch 4 of 9\n")
    time.sleep(1.5)
    run.handler.close()
    assert "Pressing patch 1, for 0 min: patch 4 of 9\n" in shown()


def test_messages_of_snakemake_itself(shown):
    run = Run(3)
    fault = {"exception": "RuleException", "level": logging.ERROR}
    text = 'RuleException:\nCalledProcessError in file "Snakefile", line 5:\nCommand failed'
    run.tell(LogEvent.ERROR, text, **fault)
    run.tell(LogEvent.ERROR, "WorkflowError:\nAt least one job did not complete successfully")
    text = 'ConfigError in file "/a/common.smk", line 33:\nmine.yaml: is bad\n  File "/a/b.py"'
    run.tell(LogEvent.ERROR, text)
    run.tell(None, "Select jobs to execute...")
    run.tell(None, "Terminating processes on user request")
    assert shown().splitlines()[1:] == [
        "ERROR: mine.yaml: is bad",
        "Terminating processes on user request",
    ]


def test_a_plan_is_the_same_in_whatever_order_snakemake_tells_it(tmp_path, monkeypatch, capsys):
    makes = {"wear": (["contact"], "depth"), "press": (["grid"], "contact"), "map": ([], "grid")}
    monkeypatch.setenv(PLAN, "1")
    monkeypatch.setenv(FILE_ONLY, "")  # restored afterwards: the display sets it
    plans = set()
    for order in permutations(makes):
        run = Run(3, dryrun=True)
        for job, rule in enumerate(order):
            inputs, output = makes[rule]
            step = {"rule_name": rule, "rule_msg": rule, "reason": "Missing output files: a"}
            step |= {"input": inputs, "output": [output], "log": [f"{tmp_path}/logs/a"]}
            run.tell(LogEvent.JOB_INFO, jobid=job, **step)
        run.handler.close()
        plans.add(capsys.readouterr().out)
    (plan,) = plans
    steps = [line.split(":")[0] for line in plan.splitlines() if not line.startswith(" ")]
    assert steps == ["map", "press", "wear", "3 steps would run."]
