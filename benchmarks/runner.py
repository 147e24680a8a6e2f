"""Options, processes and files of rows: what the scripts that make rows have in common.

A script holds its cases, a function that makes the rows of one task, and a summary of all rows.
`options` reads its command line, `pooled` or `add_rows` make the rows, and `save` stores them with
the program that made them; `run_stones` and `run_script` do it all.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import pandas as pd
from age import record

from gstlib.io.tables import read_table, write_table

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results"


def options(text, output, **defaults):
    """Options of a script, read from the command line.

    `text` is the docstring of the script, and `output` the file of its rows. `defaults` has an
    entry for each further option: its value where it is left out, or a dict of argparse's settings.
    """
    parser = argparse.ArgumentParser(description=text.splitlines()[0])
    for name, default in defaults.items():
        if isinstance(default, list):
            settings = {"type": type(default[0]), "nargs": "+", "default": default}
        elif not isinstance(settings := default, dict):
            settings = {"type": type(default), "default": default}
        parser.add_argument("--" + name.replace("_", "-"), **settings)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--output", type=Path, default=output)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    return parser.parse_args()


def pooled(make, tasks, processes):
    """Rows of all tasks that are done, in the order of the tasks, each time that one is.

    `make` is called with the parts of a task, of which the first names it. Of a task that fails,
    the error is printed, and in the end the script stops with an exit code.
    """
    tables = {}
    failed = []
    # not forked: the transforms' threads would not come along
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(make, *task): number for number, task in enumerate(tasks)}
        for count, job in enumerate(as_completed(jobs), start=1):
            number = jobs[job]
            if error := job.exception():
                failed.append(str(tasks[number][0]))
                print(f"{failed[-1]}: {error!r}", flush=True)
                continue
            tables[number] = pd.DataFrame(job.result())
            yield pd.concat([tables[key] for key in sorted(tables)], ignore_index=True)
            print(f"{count} of {len(jobs)}: {tasks[number][0]}", flush=True)
    if failed:
        raise SystemExit(
            f"{len(failed)} tasks failed and have no rows: {', '.join(failed)}"
        )


def add_rows(file, make, tasks, processes, *, order=None, digits=None):
    """Add the rows of each task to those of a file as soon as they are made.

    ``order(rows)`` sorts them. The rows of an interrupted run are kept.
    """
    earlier = [read_table(file)] if file.exists() else []
    for made in pooled(make, tasks, processes):
        rows = pd.concat([*earlier, made], ignore_index=True)
        rows = order(rows) if order else rows
        save(file, rows, digits=digits, adds=bool(earlier))


def save(file, rows, *, digits=None, adds=False):
    """Store a table, and which program made it, or some of it if it `adds` to rows."""
    if digits is None:
        write_table(file, rows)
    else:
        rows.to_csv(file, index=False, float_format=f"%.{digits}g", lineterminator="\n")
    record(file, adds=adds)


def by_seed(rows):
    """Rows by the seeds of their stones."""
    return rows.sort_values("seed", kind="stable", ignore_index=True)


def run_stones(text, file, rows_of, show, seeds, **others):
    """Make the rows of each stone that a file lacks, and print the tables of all rows.

    ``rows_of(seed)`` makes the rows of one stone, and ``show(rows)`` the tables. `text` and `file`
    are as in `options`. `others` are further options, and arguments of `rows_of` after the seed.
    """
    chosen = options(text, file, seeds=list(seeds), **others)
    if not chosen.tables:
        there = set(read_table(chosen.output).seed) if chosen.output.exists() else ()
        values = [getattr(chosen, name) for name in others]
        tasks = [(seed, *values) for seed in chosen.seeds if seed not in there]
        add_rows(chosen.output, rows_of, tasks, chosen.processes, order=by_seed)
    for table in show(read_table(chosen.output)):
        print(table.to_string(), end="\n\n")


def run_script(text, file, make, show, *, digits=None, **others):
    """Save the rows that a script makes, and print what its rows show.

    ``make(chosen)`` yields all rows that there are, again and again, by the options that were
    chosen, and ``show(rows)`` returns a text. `text`, `file` and `others` are as in `options`.
    """
    chosen = options(text, file, **others)
    if not chosen.tables:
        for rows in make(chosen):
            save(chosen.output, rows, digits=digits)
    print(show(read_table(chosen.output)))


def means(rows, keys, count):
    """Means of the rows by `keys`, and in the column `count` how many rows there are."""
    groups = rows.groupby(keys, sort=False)
    table = groups.mean(numeric_only=True).drop(columns="seed", errors="ignore")
    return table.assign(**{count: groups.size()}).reset_index()
