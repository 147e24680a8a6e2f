"""Snakemake as `gst study` starts it: ``python -m gst.run.scheduler`` takes the same arguments.

It runs again what the chain of records asks for (`gst.run.chain`), and not what Snakemake's own
records would, which know a step by its files' dates. It ends on request.
"""

import io
import json
import os
import sys
import threading
from collections.abc import Container, Iterable
from contextlib import redirect_stderr
from itertools import product
from pathlib import Path
from typing import Any

from snakemake.api import DAGApi
from snakemake.cli import args_to_api, parse_args
from snakemake.dag import DAG
from snakemake.exceptions import print_exception
from snakemake.iocontainers import Wildcards
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake.script import PythonScript
from snakemake.settings.enums import RerunTrigger

from gst.run.chain import AGAIN, LOGS, Step, hashes_of, plan_again, step_of
from gst.run.logs import ASKED
from gst.run.owned import NO_RUN, RESULTS

_end_gracefully = JobScheduler.exit_gracefully
_preamble = PythonScript.get_preamble


def steps_of(workflow: Any, results: Path) -> list[Step]:
    """The steps of a study, from the rules that Snakemake has read.

    A rule with wildcards has a step for each of its files that other steps read.
    """
    logs = results / LOGS
    rules = [
        rule for rule in workflow.rules if rule.log and Path(rule.log[0]).parent == logs
    ]
    with_wildcards = [rule for rule in rules if rule.has_wildcards()]
    jobs: list[tuple[Any, dict]] = [
        (rule, {}) for rule in rules if rule not in with_wildcards
    ]
    steps: dict[str, Step] = {}
    for rule, values in jobs:  # which grow
        wildcards = Wildcards(fromdict=values)
        inputs = rule.expand_input(wildcards)[0]
        outputs = rule.expand_output(wildcards)[0]
        params = rule.expand_params(wildcards, inputs, outputs, None)[0]
        step = step_of(rule.expand_log(wildcards)[0], params, inputs, outputs)
        if step.name in steps:
            continue
        steps[step.name] = step
        for file, maker in product(inputs, with_wildcards):
            if results in Path(file).parents and maker.is_producer(file):
                jobs.append((maker, maker.get_wildcards(file)))
    return list(steps.values())


def order_dates(steps: Iterable[Step], again: Container[str] = ()) -> None:
    """Give the outputs of steps the newest date if some input is younger; contents stay.

    Steps that have not run, or that are run `again`, are left out. Dates are not evidence: a
    copy has others, and the clock of an instrument may be wrong.
    """
    made = [
        step
        for step in steps
        if step.outputs  # not a target, which makes nothing
        and all(path.exists() for path in step.outputs)
        and str(step.outputs[0]) not in again
    ]
    paths = {path for step in made for path in (*step.inputs, *step.outputs)}
    dates = {path: _dated(path).stat().st_mtime_ns for path in paths}
    pairs = (pair for step in made for pair in product(step.inputs, step.outputs))
    if any(dates[read] > dates[output] for read, output in pairs):
        newest = max(dates.values())
        for step in made:
            for path in step.outputs:
                os.utime(_dated(path), ns=(newest, newest))


def _dated(path: Path) -> Path:
    """What Snakemake takes the date of an output from: of a folder, a hidden file in it."""
    stamp = path / ".snakemake_timestamp"
    return stamp if stamp.exists() else path


async def _date_outputs(_dag: DAG, job: Any, outputs: list[str]) -> None:
    """In place of Snakemake's check, which stops a run if an input is dated in the future."""
    inputs = [file for file in job.input if os.path.exists(file)]
    order_dates([step_of("", {}, inputs, outputs)])


def _with_failed_start(script: PythonScript) -> str:
    """Snakemake's first lines of a script; an error in an import after them is logged, too."""
    lines = "from gst.run.logs import log_failed_start; log_failed_start(snakemake)\n"
    return _preamble(script) + lines


def adapt(
    workflow: Any, steps: list[Step], results: Path, accepted: Container[str]
) -> None:
    """Adapt Snakemake to steps that are known by their records; the Snakefile calls this.

    The main process notes what runs again, and what each step was asked: on a cluster a job reads
    the config anew, which may have been edited meanwhile.
    """
    DAG.check_output_mtime = _date_outputs
    PythonScript.get_preamble = _with_failed_start
    if workflow.is_main_process:
        AGAIN.update(plan_again(steps, results, accepted))
        order_dates(steps, AGAIN)
        asked = json.loads(os.environ.get(ASKED, "{}"))
        asked[str(results)] = hashes_of(steps, results)
        os.environ[ASKED] = json.dumps(asked)


def end(scheduler: JobScheduler, *_: Any) -> None:
    """On SIGTERM. Snakemake's handler waits for a lock, which what it interrupted may hold."""
    threading.Thread(target=_end_gracefully, args=[scheduler]).start()


def _parsed(words: list[str]) -> tuple[Any, Any]:
    """Snakemake's parser, and what it makes of these words; not its line that names the profile."""
    messages = io.StringIO()
    try:
        with redirect_stderr(messages):
            return parse_args(words)
    finally:
        lines = messages.getvalue().splitlines(keepends=True)
        sys.stderr.writelines(line for line in lines if not line.startswith("Using "))


def main() -> None:
    """Run Snakemake; the exit code is 0 if all went well, else 1.

    Under `gst study`, it is `NO_RUN` if no step was to run.
    """
    JobScheduler.exit_gracefully = end
    runs: list[bool] = []
    execute = DAGApi.execute_workflow

    def noted(*arguments: Any, **options: Any) -> None:
        runs.append(True)
        execute(*arguments, **options)  # raises an error if a step fails

    DAGApi.execute_workflow = noted
    try:
        parser, arguments = _parsed(sys.argv[1:])
        AGAIN.update(dict.fromkeys(arguments.forcerun, "asked for"))
        arguments.forcerun = AGAIN  # the Snakefile adds to it before Snakemake looks
        # it cannot do without; `plan_again` knows
        arguments.rerun_triggers = {RerunTrigger.MTIME}
        is_done = args_to_api(arguments, parser)
    except Exception as error:
        print_exception(error)
        sys.exit(1)
    is_run = runs and not (arguments.dryrun or arguments.touch)
    if is_done and RESULTS in os.environ and not is_run:
        sys.exit(NO_RUN)
    sys.exit(not is_done)


if __name__ == "__main__":
    main()
