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
    assert capsys.readouterr().err == "ERROR: scan.plu: is empty. Copy it again.\n"
    assert log.read_text() == "ERROR scan.plu: is empty. Copy it again.\n"
    with pytest.raises(SystemExit), job_log(log):
        raise ZeroDivisionError("oops")
    assert "Traceback" in capsys.readouterr().err
    (shown,) = logged(log, "ERROR")
    assert "Traceback" not in shown
    for words in ("bug in the program", "test_logs.py", "ZeroDivisionError: oops"):
        assert words in shown


def test_a_missing_package_stands_in_the_log(tmp_path):
    """Also where a script ends before it calls `run_script`; a log of an end is not empty."""
    log = tmp_path / "job.log"
    for line, said in (("import no_such", "No module named 'no_such'"), ("1 / 0", "ZeroDivision")):
        start = f"snakemake = SimpleNamespace(log=[{str(log)!r}])\nlog_failed_start(snakemake)\n"
        given = "from types import SimpleNamespace\nfrom gst.run.logs import log_failed_start\n"
        ended = subprocess.run([sys.executable, "-c", given + start + line], check=False)
        assert ended.returncode == 1
        (shown,) = logged(log, "ERROR")
        assert said in shown
        assert ("install" in shown) == ("no_such" in line)


def test_warnings_reach_the_log(tmp_path, capsys):
    level = logging.getLogger("gstlib").level
    with job_log(tmp_path / "job.log"):
        logging.getLogger("gstlib.anything").info("step 1")
        warnings.warn("contact at the border", UserWarning, stacklevel=1)
    text = (tmp_path / "job.log").read_text()
    assert text.splitlines() == ["INFO step 1", "WARNING UserWarning: contact at the border"]
    assert "contact at the border" in capsys.readouterr().err
    assert logging.getLogger("gstlib").level == level


def test_each_message_is_read_back_whichever_follows(tmp_path):
    levels = {"ERROR": logging.ERROR, "WARNING": logging.WARNING, "NOTE": NOTE}
    for first, second in permutations(levels, 2):
        with job_log(tmp_path / "job.log") as log:
            for level in (first, second):
                log.log(levels[level], "%s: a patch\n  and another line", level.lower())
        for level in levels:
            expected = [f"{level.lower()}: a patch\n  and another line"]
            found = logged(tmp_path / "job.log", level)
            assert found == (expected if level in (first, second) else [])


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
def said(monkeypatch, capsys):
    """What the display shows."""
    monkeypatch.setenv(FILE_ONLY, "")  # restored afterwards: the display sets it
    return lambda: capsys.readouterr().err


def test_the_display_counts_the_steps_without_control_characters(said):
    run = Run(40)
    run.handler.to_do += 1  # of a step whose end is not yet told
    for job in range(1, 41):
        run.begin(job)
        run.end(job)
    run.end(41)  # the rule that only names the others
    run.handler.close()
    shown = said()
    assert shown.startswith("40 steps to do.\n0:00:00  Pressing patch 1\n")
    tenths = [f"{done} of 40" for done in range(4, 41, 4)]
    assert re.findall(r"(\d+ of 40) steps done", shown) == tenths
    assert "40 of 40 steps done\n" in shown
    assert shown.endswith("All 40 steps are done, after 0:00:00.\n")
    assert not re.search(r"[^\x20-\x7e\n]", shown)


def test_a_single_step_is_not_called_steps(said):
    run = Run(1)
    run.begin(1)
    run.end(1)
    run.handler.close()
    first, *_, last = said().splitlines()
    assert (first, last) == ("1 step to do.", "The step is done, after 0:00:00.")


def test_the_display_shows_warnings_and_the_error_of_a_failed_step_once(said, tmp_path):
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
    shown = said()
    assert "yesterday" not in shown
    assert f"\nERROR: {_SILENT}\n  step: Pressing patch 3" in shown
    place = f"\n  step: Pressing patch %d\n  log:  {log}\n"
    assert f"WARNING: patch 2 was not found\nsee the map{place % 1}" in shown
    assert f"\nERROR: scan.plu: is empty. Copy it again.{place % 2}" in shown
    assert shown.count("is empty") == 1
    assert "Stopped with 1 of 4 steps done, after 0:00:00. Repeat the same command" in shown


def test_the_time_that_is_left_is_that_of_the_steps_not_yet_done(said, monkeypatch):
    run, costs = Run(10), plugin._COSTS
    monkeypatch.setattr(plugin.time, "monotonic", lambda: run.handler.start + 300)
    run.handler.to_do = 4 * costs["solve_patches"]
    for job in (1, 2, 3):
        run.begin(job)
        run.end(job)
    # a quarter of the work took five minutes, then a half, then three quarters
    assert re.findall(r"(\d+) of 10 steps done, about (\d+) min left", said()) == [
        ("1", "15"),
        ("2", "5"),
        ("3", "2"),
    ]


def test_silence_ends_with_how_far_the_running_steps_are(said, monkeypatch, tmp_path):
    monkeypatch.setattr(plugin, "_SILENCE", 0.0)
    run, log = Run(4), tmp_path / "job.log"
    run.begin(1, log)
    log.write_text("INFO patch 3\nINFO patch 4 of 9\n")
    time.sleep(1.5)
    run.handler.close()
    assert "Pressing patch 1, for 0 min: patch 4 of 9\n" in said()


def test_messages_of_snakemake_itself(said):
    run = Run(3)
    fault = {"exception": "RuleException", "level": logging.ERROR}
    text = 'RuleException:\nCalledProcessError in file "Snakefile", line 5:\nCommand failed'
    run.tell(LogEvent.ERROR, text, **fault)
    run.tell(LogEvent.ERROR, "WorkflowError:\nAt least one job did not complete successfully")
    text = 'ConfigError in file "/a/common.smk", line 33:\nmine.yaml: is bad\n  File "/a/b.py"'
    run.tell(LogEvent.ERROR, text)
    run.tell(None, "Select jobs to execute...")
    run.tell(None, "Terminating processes on user request")
    assert said().splitlines()[1:] == [
        "ERROR: mine.yaml: is bad",
        "Terminating processes on user request",
    ]


def test_a_plan_is_the_same_in_whatever_order_snakemake_tells_it(tmp_path, monkeypatch, capsys):
    makes = {"wear": (["contact"], "depth"), "press": (["grid"], "contact"), "map": ([], "grid")}
    monkeypatch.setenv(PLAN, "1")
    monkeypatch.setenv(FILE_ONLY, "")  # restored afterwards: the display sets it
    shown = set()
    for order in permutations(makes):
        run = Run(3, dryrun=True)
        for job, rule in enumerate(order):
            inputs, output = makes[rule]
            facts = {"rule_name": rule, "rule_msg": rule, "reason": "Missing output files: a"}
            facts |= {"input": inputs, "output": [output], "log": [f"{tmp_path}/logs/a"]}
            run.tell(LogEvent.JOB_INFO, jobid=job, **facts)
        run.handler.close()
        shown.add(capsys.readouterr().out)
    (plan,) = shown
    steps = [line.split(":")[0] for line in plan.splitlines() if not line.startswith(" ")]
    assert steps == ["map", "press", "wear", "3 steps would run."]
