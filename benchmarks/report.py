"""From results/*.csv: the tables in README.md, and what the issue of speed asks, met or not."""

import json
from pathlib import Path

import pandas as pd
from cases import CASES, Growth
from problems import CUT_OFF

README = Path(__file__).parent / "README.md"
OWN = "gstlib, load"
MET = {True: "yes", False: "**no**"}
BEGIN, END = "<!-- results: begin -->", "<!-- results: end -->"
# Part of the name of a peer, and how it is called beside a case; then the factors that are asked.
PEERS = {"": ": fastest peer", "slippy, BCCG": "", "Tamaas": ""}
TARGETS = {
    "rough-76": ("Cold, 76 MPa", [3, 5, 20]),
    "rough-22": ("Cold, 22 MPa", [3, 5, 20]),
    "hertz-256": ("Sphere 256²", [3, 5, 20]),
    "hertz-512": ("Sphere 512²", [3, 5, 20]),
    "path-76": ("20 steps to 76 MPa", [5]),
    "path-22": ("20 steps to 22 MPa", [5]),
    "periodic-76": ("Periodic, 76 MPa", 3 * [None]),
    "periodic-2000": ("Periodic, 2000 MPa", 3 * [None]),
}
KEY = ["code", "size", "cut_off"]


def write_report(results):
    """Renew the part of README.md between its markers, and the figure."""
    files = {name: results / f"{name}.csv" for name in CASES}
    tables = {name: pd.read_csv(file) for name, file in files.items() if file.exists()}
    machine = json.loads((results / "machine.json").read_text("utf-8"))
    parts = [machine_list(machine), target_table(tables)]
    for name, table in tables.items():
        make = growth_table if isinstance(CASES[name], Growth) else case_table
        parts.append(f"## {CASES[name].title}\n\n{make(table)}")
    head, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    text = "\n\n".join([head + BEGIN, *parts, END + rest.partition(END)[2]])
    README.write_text(text, encoding="utf-8")

    # Here, so that the tests of this folder do without matplotlib.
    from figure import draw

    draw(tables, results / "peers.png")


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
        key: (ratio.prod() ** (1 / len(ratio)), ratio.max())
        for key, ratio in ratios.groupby(KEY).ratio
    }


def target_table(tables):
    """What was to be reached, what was measured."""
    lines = []
    for name, (words, factors) in TARGETS.items():
        for (part, called), factor in zip(PEERS.items(), factors, strict=False):
            lines += against_peer(tables[name], part, words + called, factor)
    growth = tables["growth"]
    for (code, size, cut_off), (mean, worst) in growth_factors(growth).items():
        if code == OWN:
            waves = "" if cut_off == CUT_OFF else ", with the same waves"
            sizes = f"Convolutions from {size / 2:.0f}² to {size:.0f}²{waves}: mean over seeds"
            measured = f"{mean:.2f} (single surface {worst:.2f})"
            lines.append((sizes, "≤ 1.25", measured, MET[mean <= 1.25]))
    largest = "code == @OWN and cut_off == @CUT_OFF and size >= 2048 and seed == 0"
    for row in growth.query(largest).itertuples():
        measured = f"{row.wall_median:.0f} s, {row.peak_mb / 1e3:.2f} GB"
        met = MET[row.reached == "yes"]
        lines.append((f"{row.size:.0f}²", "solved", measured, met))
    return _lines(" | asked | measured | met", lines)


def against_peer(table, part, words, factor):
    """The line that holds our code against the cheapest peer with `part` in its name, if any."""
    reached = by_time(table[table.reached == "yes"])
    is_peer = reached.code.str.contains(part) & ~reached.code.str.startswith("gstlib")
    for peer in reached[is_peer].head(1).itertuples():
        ratio = peer.ratio  # of unrounded medians, as in the tables below
        asked, met = (f"≥ {factor}×", MET[ratio >= factor]) if factor else ("", "")
        yield f"{words} ({peer.code})", asked, f"{ratio:.1f}×", met


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
