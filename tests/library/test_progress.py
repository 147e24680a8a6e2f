import io
import re
from pathlib import Path

import pytest

from gstlib.errors import InputError
from gstlib.logs import FILE_ONLY, job_log
from gstlib.progress import Progress, duration, error_in, warnings_in


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock():
    """Seconds that pass when they are told to."""

    class Clock:
        now = 0.0

        def __call__(self):
            return self.now

    return Clock()


def run(progress, clock, steps, total, seconds=1.0):
    """Steps one after the other, as Snakemake tells of them."""
    for job in steps:
        progress.begin(job, f"step {job}")
        clock.now += seconds
        progress.end(job)
        progress.count(job, total)


def test_counts_are_right_when_the_checkpoint_adds_steps(clock):
    stream = io.StringIO()
    progress = Progress(stream, clock)
    progress.plan(20, growing=True)
    run(progress, clock, range(1, 11), total=20)
    run(progress, clock, range(11, 41), total=40)
    progress.close()
    said = stream.getvalue()
    plan, *lines, last = said.splitlines()
    assert "20 steps" in plan
    assert "more" in plan
    assert last == "All is done: 40 steps in 40 s."
    counts = [re.match(r"(\d+) of (\d+)(\+?) steps done, (\d+) s", line) for line in lines]
    assert [match[1] == match[4] for match in counts] == [True] * len(lines)  # a second a step
    known = [(int(match[1]), int(match[2]), match[3]) for match in counts]
    first, then = range(2, 11, 2), range(12, 41, 4)
    assert known == [(n, 20, "+") for n in first] + [(n, 40, "") for n in then]
    # no guess while steps are unknown; a step a second afterwards
    assert "left" not in "".join(lines[:5])
    assert "12 of 40 steps done, 12 s, about 28 s left" in said


def test_few_lines_and_no_control_characters_outside_a_terminal(clock):
    stream = io.StringIO()
    progress = Progress(stream, clock)
    progress.plan(2500, growing=False)
    run(progress, clock, range(1, 2501), total=2500)
    progress.close()
    said = stream.getvalue()
    assert len(said.splitlines()) == 12
    assert not re.search(r"[^\x20-\x7e\n]", said)


def test_a_terminal_gets_a_line_for_each_step_and_one_that_is_renewed(clock):
    stream = Terminal()
    progress = Progress(stream, clock)
    progress.plan(4, growing=False)
    run(progress, clock, range(1, 5), total=4, seconds=100.0)
    progress.close()
    shown = stream.getvalue().replace("\r\x1b[K", "\n").splitlines()
    assert "      3 of 4   1 min 40 s  step 3" in shown
    assert "3 of 4 steps done, 5 min 00 s, about 1 min 40 s left. Now: step 4" in shown
    assert shown[-1] == "All is done: 4 steps in 6 min 40 s."


def failing(tmp_path, progress, error):
    """A step that ends in `error`, and the log it leaves."""
    log = tmp_path / "job.log"
    progress.begin(1, "Cleaning the scans", str(log))
    with pytest.raises(SystemExit), job_log(log):
        raise error
    progress.fail(1, "prepare_scans", [str(log)])
    progress.close()
    return log


def test_a_failed_step_says_its_own_error_once(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(FILE_ONLY, "1")
    stream = io.StringIO()
    progress = Progress(stream)
    progress.plan(3, growing=False)
    log = failing(tmp_path, progress, InputError("scan.plu", "is empty", "Copy it again."))
    said = stream.getvalue()
    assert said.count("scan.plu: is empty. Copy it again.") == 1
    assert f"step: Cleaning the scans\n  log:  {log}\n" in said
    assert "Stopped after 0 s with 0 of 3 steps done" in said
    assert capsys.readouterr().err == ""  # the step itself says it to its log alone


def test_a_fault_of_the_program_shows_where_it_is(tmp_path, monkeypatch):
    monkeypatch.setenv(FILE_ONLY, "1")
    stream = io.StringIO()
    progress = Progress(stream)
    progress.plan(3, growing=False)
    failing(tmp_path, progress, ZeroDivisionError("oops"))
    said = stream.getvalue()
    assert "fault of the program" in said
    assert "test_progress.py" in said
    assert "ZeroDivisionError: oops" in said
    assert "Traceback" not in said


def test_what_an_earlier_run_left_in_the_log_is_not_said_again(tmp_path):
    log = tmp_path / "job.log"
    log.write_text("ERROR something of yesterday\n")
    stream = io.StringIO()
    progress = Progress(stream)
    progress.plan(3, growing=False)
    progress.begin(1, "Pressing", str(log))
    progress.fail(1, "solve_patch", [str(log)])  # killed before it wrote anything
    assert "yesterday" not in stream.getvalue()
    assert "without saying why" in stream.getvalue()


def test_warnings_of_a_step_are_shown(tmp_path):
    log = tmp_path / "job.log"
    stream = io.StringIO()
    progress = Progress(stream)
    progress.plan(1, growing=False)
    progress.begin(1, "Placing", str(log))
    log.write_text("INFO patch 1\nWARNING patch 2 lies elsewhere\nsee the map\nINFO patch 3\n")
    progress.end(1)
    assert "WARNING: patch 2 lies elsewhere\nsee the map\n  step: Placing" in stream.getvalue()


def test_what_a_log_says():
    log = "INFO a\nWARNING b\nERROR c: two problems\n  - one\n  - two\n"
    assert warnings_in(log) == ["b"]
    assert error_in(log) == "c: two problems\n  - one\n  - two"
    assert error_in("INFO step 1 of 20\n") is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_log_that_cannot_be_written_is_said_to_the_screen(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(FILE_ONLY, "1")
    with pytest.raises(SystemExit), job_log("/dev/full"):
        raise InputError("results", "the disk is full", "Make room.")
    assert capsys.readouterr().err.strip() == "ERROR: results: the disk is full. Make room."


@pytest.mark.parametrize(("seconds", "said"), [(59.6, "1 min 00 s"), (3599.7, "1 h 00 min")])
def test_durations_carry_over(seconds, said):
    assert duration(seconds) == said
