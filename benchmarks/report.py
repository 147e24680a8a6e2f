"""From results/*.csv: the tables in README.md."""

import json
from pathlib import Path

import pandas as pd
from cases import CASES, Growth
from problems import CUT_OFF
from scipy.stats import gmean

README = Path(__file__).parent / "README.md"
BEGIN, END = "<!-- results: begin -->", "<!-- results: end -->"
KEY = ["code", "size", "cut_off"]


def write_report(results):
    """Renew the part of README.md between its markers."""
    files = {name: results / f"{name}.csv" for name in CASES}
    tables = {name: pd.read_csv(file) for name, file in files.items() if file.exists()}
    machine = json.loads((results / "machine.json").read_text("utf-8"))
    parts = [machine_list(machine)]
    for name, table in tables.items():
        make = growth_table if isinstance(CASES[name], Growth) else case_table
        parts.append(f"## {CASES[name].title}\n\n{make(table)}")
    head, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    text = "\n\n".join([head + BEGIN, *parts, END + rest.partition(END)[2]])
    README.write_text(text, encoding="utf-8")


def machine_list(machine):
    """What the measurements were made with: a line, and a list."""
    codes, libraries = (
        ", ".join(f"{name} {version}" for name, version in machine[part].items())
        for part in ("codes", "gstlib_with")
    )
    return (
        f"Measured on {machine['date']}, on a machine with {machine['cores']} cores and "
        f"{machine['memory_gib']} GiB:\n\n"
        f"- processor: {machine['processor']}\n"
        f"- system: {machine['system']}\n"
        f"- codes: {codes}\n"
        f"- libraries of gstlib: {libraries}"
    )


def by_time(table):
    """Cheapest first among those that reach the accuracy, then the others."""
    return table.sort_values(
        ["reached", "cpu_median"], ascending=[False, True], kind="stable"
    )


def case_table(table):
    """One line per code."""
    columns = """code | CPU s, median (min) | CPU to gstlib's | wall s, median | iterations |
    convolutions | peak MB (solve) | gap error"""
    lines = [
        [
            row.code,
            f"{row.cpu_median:.3g} ({row.cpu_min:.3g})",
            f"{row.ratio:.1f}" if row.reached == "yes" and row.ratio > 0 else "",
            f"{row.wall_median:.3g}",
            _range([row.iterations]),
            _range([row.convolutions]),
            f"{row.peak_mb:.0f} ({row.added_mb:.0f})",
            _error([row.gap_error], [row.reached]),
        ]
        for row in by_time(table).itertuples()
    ]
    return _lines(columns, lines)


def growth_table(table):
    """A line for each code and size: iterations, convolutions, CPU, memory; mean over seeds."""
    columns = """code | grid | seeds | iterations | convolutions | × per doubling (worst) |
    CPU s | wall s | peak MB | gap error"""
    factors = growth_factors(table)
    lines = []
    for key, group in table.groupby(KEY, sort=False):
        code, size, cut_off = key
        waves = f", waves of {size / 2:.0f}²" if cut_off != CUT_OFF else ""
        factor = "{:.2f} ({:.2f})".format(*factors[key]) if key in factors else ""
        lines.append(
            [
                code,
                f"{size:.0f}²{waves}",
                f"{len(group)}",
                _range(group.iterations),
                _range(group.convolutions),
                factor,
                f"{group.cpu_median.mean():.3g}",
                f"{group.wall_median.mean():.3g}",
                f"{group.peak_mb.max():.0f}",
                _error(group.gap_error, group.reached),
            ]
        )
    return _lines(columns, lines)


def growth_factors(table):
    """Growth of convolutions from half the size: {(code, size, cut_off): (geometric mean, worst)}.

    Half the size has the usual shortest wave in elements: with another cut-off, the same in mm.
    """
    coarse = table[table.cut_off == CUT_OFF].assign(size=table["size"] * 2)
    pairs = table.merge(coarse, on=["code", "size", "seed"], suffixes=("", "_half"))
    ratios = pairs.assign(ratio=pairs.convolutions / pairs.convolutions_half)
    return {
        key: (gmean(ratio), ratio.max()) for key, ratio in ratios.groupby(KEY).ratio
    }


def _range(counts):
    counts = [f"{count:.0f}" for count in sorted(counts) if pd.notna(count)]
    return "–".join(dict.fromkeys([*counts[:1], *counts[-1:]]))


def _error(errors, reached):
    missed = "" if all(answer == "yes" for answer in reached) else " **not reached**"
    return f"{max(errors):.1e}{missed}"


def _lines(columns, rows):
    """A Markdown table of texts; the names of the columns are separated by bars."""
    head = [name.strip() for name in columns.split("|")]
    return "\n".join(
        f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)
    )
