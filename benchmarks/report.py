"""From results/*.csv: the tables in README.md, and what the issue of speed asks, met or not."""

import json
import statistics
from pathlib import Path

import pandas as pd
from cases import CASES, Growth
from problems import CUT_OFF

README = Path(__file__).parent / "README.md"
OWN = "gstlib, load"
MET = {True: "yes", False: "**no**"}
BEGIN, END = "<!-- results: begin -->", "<!-- results: end -->"


def write_report(results):
    """Renew the part of README.md between its markers, and the figure."""
    tables = {name: read_table(results / f"{name}.csv") for name in CASES}
    machine = json.loads((results / "machine.json").read_text("utf-8"))
    parts = [machine_list(machine), target_table(tables)]
    for name, case in CASES.items():
        if tables[name]:
            make = growth_table if isinstance(case, Growth) else case_table
            parts.append(f"## {case.title}\n\n{make(tables[name])}")
    head, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    text = "\n\n".join([head + BEGIN, *parts, END + rest.partition(END)[2]])
    README.write_text(text, encoding="utf-8")

    # Here, so that the tests of this folder do without matplotlib.
    from figure import draw

    draw(tables, results / "peers.png")


def read_table(path):
    """Rows as dicts; empty cells are None."""
    if not path.exists():
        return []
    table = pd.read_csv(path).astype(object)
    return table.where(table.notna(), None).to_dict("records")


def machine_list(machine):
    """What the measurements were made with: a line, and a list."""
    versions = [
        ", ".join(f"{name} {version}" for name, version in machine[part].items())
        for part in ("codes", "gstlib_with")
    ]
    return (
        f"Measured on {machine['date']}, on a machine with {machine['cores']} cores and "
        f"{machine['memory_gib']} GiB:\n\n"
        f"- processor: {machine['processor']}\n"
        f"- system: {machine['system']}\n"
        f"- codes: {versions[0]}\n"
        f"- libraries of gstlib: {versions[1]}"
    )


def case_table(rows):
    """One line per code, cheapest first among those that reach the accuracy."""
    rows = sorted(rows, key=lambda row: (row["reached"] != "yes", row["cpu_median"]))
    cells = {
        "code": lambda row: row["code"],
        "CPU s, median (min)": lambda row: (
            f"{row['cpu_median']:.3g} ({row['cpu_min']:.3g})"
        ),
        "CPU to gstlib's": lambda row: (
            f"{row['ratio']:.1f}" if row["ratio"] and row["reached"] == "yes" else ""
        ),
        "wall s, median": lambda row: f"{row['wall_median']:.3g}",
        "iterations": lambda row: _range([row], "iterations"),
        "convolutions": lambda row: _range([row], "convolutions"),
        "peak MB (solve)": lambda row: f"{row['peak_mb']:.0f} ({row['added_mb']:.0f})",
        "gap error": lambda row: _error([row]),
    }
    return _markdown(cells, rows)


def growth_table(rows):
    """Sizes down, codes across groups: iterations, convolutions, CPU, memory; mean over seeds."""
    factors = growth_factors(rows)
    groups = {}
    for row in rows:
        groups.setdefault(_key(row), []).append(row)

    def grid(group):
        _, size, cut_off = _key(group[0])
        return f"{size:.0f}²" + (
            f", waves of {size / 2:.0f}²" if cut_off != CUT_OFF else ""
        )

    def factor(group):
        mean, worst = factors.get(_key(group[0]), (None, None))
        return f"{mean:.2f} ({worst:.2f})" if mean else ""

    def seconds(name):
        return lambda group: f"{statistics.mean(row[name] for row in group):.3g}"

    cells = {
        "code": lambda group: group[0]["code"],
        "grid": grid,
        "seeds": lambda group: f"{len(group)}",
        "iterations": lambda group: _range(group, "iterations"),
        "convolutions": lambda group: _range(group, "convolutions"),
        "× per doubling (worst)": factor,
        "CPU s": seconds("cpu_median"),
        "wall s": seconds("wall_median"),
        "peak MB": lambda group: f"{max(row['peak_mb'] for row in group):.0f}",
        "gap error": _error,
    }
    return _markdown(cells, groups.values())


def growth_factors(rows):
    """Growth of convolutions from half the size: {(code, size, cut_off): (geometric mean, worst)}.

    Half the size has the usual shortest wave in elements: with another cut-off, the same in mm.
    """
    counts = {(*_key(row), row["seed"]): row["convolutions"] for row in rows}
    ratios = {}
    for (code, size, cut_off, seed), count in counts.items():
        half = counts.get((code, size / 2, CUT_OFF, seed))
        if count and half:
            ratios.setdefault((code, size, cut_off), []).append(count / half)
    return {
        key: (statistics.geometric_mean(each), max(each))
        for key, each in ratios.items()
    }


def _key(row):
    return row["code"], row["size"], row["cut_off"]


# Part of the name of a peer, and how it is called beside a case; then the factors that are asked.
PEERS = {"": ": fastest peer", "aspher native": ": aspher for this processor"}
PEERS |= {"slippy, BCCG": "", "Tamaas": ""}
TARGETS = {
    "rough-76": ("Cold, 76 MPa", [3, None, 5, 20]),
    "rough-22": ("Cold, 22 MPa", [3, None, 5, 20]),
    "hertz-256": ("Sphere 256²", [3, None, 5, 20]),
    "hertz-512": ("Sphere 512²", [3, None, 5, 20]),
    "path-76": ("20 steps to 76 MPa", [5]),
    "path-22": ("20 steps to 22 MPa", [5]),
    "periodic-76": ("Periodic, 76 MPa", 4 * [None]),
    "periodic-2000": ("Periodic, 2000 MPa", 4 * [None]),
}


def target_table(tables):
    """What was to be reached, what was measured."""
    lines = []
    for name, (words, factors) in TARGETS.items():
        for (part, called), factor in zip(PEERS.items(), factors, strict=False):
            lines += against_peer(tables[name], part, words + called, factor)
    for (code, size, cut_off), (mean, worst) in growth_factors(
        tables["growth"]
    ).items():
        if code == OWN:
            waves = "" if cut_off == CUT_OFF else ", with the same waves"
            sizes = f"Convolutions from {size / 2:.0f}² to {size:.0f}²{waves}: mean over seeds"
            measured = f"{mean:.2f} (single surface {worst:.2f})"
            lines.append((sizes, "≤ 1.25", measured, MET[mean <= 1.25]))
    for row in tables["growth"]:
        if (
            _key(row)[::2] == (OWN, CUT_OFF)
            and row["size"] >= 2048
            and row["seed"] == 0
        ):
            measured = f"{row['wall_median']:.0f} s, {row['peak_mb'] / 1e3:.2f} GB"
            lines.append(
                (
                    f"{row['size']:.0f}²",
                    "solved",
                    measured,
                    MET[row["reached"] == "yes"],
                )
            )
    return _lines(["", "asked", "measured", "met"], lines)


def against_peer(rows, part, words, factor):
    """The line that holds our code against the cheapest peer with `part` in its name, if any."""
    rows = [row for row in rows if row["reached"] == "yes"]
    own = [row for row in rows if row["code"] == OWN]
    # As the registry installs them, unless another build is asked for.
    peers = [
        row
        for row in rows
        if part in row["code"]
        and not row["code"].startswith("gstlib")
        and ("native" in row["code"]) == ("native" in part)
    ]
    if own and peers:
        peer = min(peers, key=lambda row: row["cpu_median"])
        ratio = peer["ratio"]  # of unrounded medians, as in the tables below
        asked, met = (f"≥ {factor}×", MET[ratio >= factor]) if factor else ("", "")
        yield f"{words} ({peer['code']})", asked, f"{ratio:.1f}×", met


def _range(rows, name):
    counts = [row[name] for row in rows if row[name] is not None]
    ends = (
        {f"{count:.0f}": None for count in (min(counts), max(counts))} if counts else {}
    )
    return "–".join(ends)


def _error(rows):
    missed = "" if all(row["reached"] == "yes" for row in rows) else " **not reached**"
    return f"{max(row['gap_error'] for row in rows):.1e}{missed}"


def _markdown(cells, rows):
    """A table with a column for each of `cells`, which make the text of a row."""
    return _lines(list(cells), [[make(row) for make in cells.values()] for row in rows])


def _lines(head, rows):
    return "\n".join(
        f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)
    )
