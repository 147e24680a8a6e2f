"""Snakemake as `gst study` starts it: ``python -m gst.scheduler`` takes the same arguments.

It runs again what the chain of records asks for (`gst.chain`), and not what Snakemake's own records
would, which know a step by its files' dates. It ends when it is told to.
"""

import io
import sys
import threading
from contextlib import redirect_stderr
from typing import Any

from snakemake.cli import args_to_api, parse_args
from snakemake.exceptions import print_exception
from snakemake.scheduling.job_scheduler import JobScheduler
from snakemake.settings.enums import RerunTrigger

from gst.chain import AGAIN

_end_gracefully = JobScheduler.exit_gracefully


def end(scheduler: JobScheduler, *_: Any) -> None:
    """On SIGTERM. Snakemake's handler waits for a lock, which what it interrupted may hold."""
    threading.Thread(target=_end_gracefully, args=[scheduler]).start()


def _parsed(words: list[str]) -> tuple[Any, Any]:
    """Snakemake's parser, and what it makes of these words; not its line that names the profile."""
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            return parse_args(words)
    finally:
        lines = said.getvalue().splitlines(keepends=True)
        sys.stderr.writelines(line for line in lines if not line.startswith("Using "))


def main() -> None:
    """Run Snakemake; the exit code is 0 if all went well, else 1."""
    JobScheduler.exit_gracefully = end
    try:
        parser, arguments = _parsed(sys.argv[1:])
        AGAIN.update(dict.fromkeys(arguments.forcerun, "asked for"))
        arguments.forcerun = AGAIN  # the Snakefile adds to it before Snakemake looks
        # it cannot do without; `plan_again` knows
        arguments.rerun_triggers = {RerunTrigger.MTIME}
        is_done = args_to_api(arguments, parser)
    except Exception as error:
        print_exception(error)
        is_done = False
    sys.exit(not is_done)


if __name__ == "__main__":
    main()
