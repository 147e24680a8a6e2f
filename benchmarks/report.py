"""From results/*.csv: the tables in README.md, and what the issue of speed asks, met or not."""

import csv
import json
import statistics
from pathlib import Path

from cases import CASES, Growth
from problems import CUT_OFF

__all__ = ["growth_factors", "read_table", "write_report"]

README = Path(__file__).parent / "README.md"
OWN = "gstlib, load"


def write_report(results):
    """Renew the part of README.md between its markers, and the figure."""
    tables = {name: read_table(results / f"{name}.csv") for name in CASES}
    parts = []
    if (results / "machine.json").exists():
        parts.append(machine_line(json.loads((results / "machine.json").read_text("utf-8"))))
    parts.append(target_table(tables))
    for name, case in CASES.items():
        if tables[name]:
            make = growth_table if isinstance(case, Growth) else case_table
            parts.append(f"## {case.title}\n\n{make(tables[name])}")
    begin, end = "<!-- results: begin -->", "<!-- results: end -->"
    text = README.read_text(encoding="utf-8")
    head, _, rest = text.partition(begin)
    _, _, tail = rest.partition(end)
    body = "\n\n".join(parts)
    README.write_text(f"{head}{begin}\n\n{body}\n\n{end}{tail}", encoding="utf-8")

    # Here, so that the tests of this folder do without matplotlib.
    from figure import draw

    draw(tables, results / "peers.png")


def read_table(path):
    """Rows with numbers as numbers; empty cells are None."""
    if not path.exists():
        return []

    def value(key, text):
        if text == "":
            return None
        return text if key in ("code", "control", "reached") else float(text)

    with open(path, newline="", encoding="utf-8") as file:
        return [{k: value(k, v) for k, v in row.items()} for row in csv.DictReader(file)]


def machine_line(machine):
    codes = "; ".join(f"{name} {version}" for name, version in machine["codes"].items())
    own = ", ".join(f"{name} {version}" for name, version in machine["gstlib_with"].items())
    return (
        f"Measured on {machine['date']}: {machine['processor']}; {machine['cores']} cores, "
        f"{machine['memory_gib']} GiB, {machine['system']}. {codes}. gstlib with {own}."
    )


def case_table(rows):
    """One line per code, cheapest first among those that reach the accuracy."""
    rows = sorted(rows, key=lambda r: (r["reached"] != "yes", r["cpu_median"]))
    head = ["code", "CPU s, median (min)", "CPU to gstlib's", "wall s, median", "iterations"]
    head += ["convolutions", "peak MB (solve)", "gap error"]
    body = []
    for r in rows:
        missed = "" if r["reached"] == "yes" else " **not reached**"
        ratio = r["ratio"] if r["reached"] == "yes" else None
        body.append(
            [
                r["code"],
                f"{r['cpu_median']:.3g} ({r['cpu_min']:.3g})",
                "" if ratio is None else f"{ratio:.1f}",
                f"{r['wall_median']:.3g}",
                _count(r["iterations"]),
                _count(r["convolutions"]),
                f"{r['peak_mb']:.0f} ({r['added_mb']:.0f})",
                f"{r['gap_error']:.1e}{missed}",
            ]
        )
    return _markdown(head, body)


def growth_table(rows):
    """Sizes down, codes across groups: iterations, convolutions, CPU, memory; mean over seeds."""
    body = []
    factors = growth_factors(rows)
    for of in dict.fromkeys((r["code"], r["size"], r["cut_off"]) for r in rows):
        group = [r for r in rows if (r["code"], r["size"], r["cut_off"]) == of]
        code, size, cut_off = of
        waves = f", waves of {size / 2:.0f}²" if cut_off != CUT_OFF else ""
        factor = factors.get(of)
        reached = all(r["reached"] == "yes" for r in group)
        body.append(
            [
                code,
                f"{size:.0f}²{waves}",
                f"{len(group)}",
                _range(r["iterations"] for r in group),
                _range(r["convolutions"] for r in group),
                f"{factor[0]:.2f} ({factor[1]:.2f})" if factor else "",
                f"{statistics.mean(r['cpu_median'] for r in group):.3g}",
                f"{statistics.mean(r['wall_median'] for r in group):.3g}",
                f"{max(r['peak_mb'] for r in group):.0f}",
                f"{max(r['gap_error'] for r in group):.1e}"
                + ("" if reached else " **not reached**"),
            ]
        )
    head = ["code", "grid", "seeds", "iterations", "convolutions", "× per doubling (worst)"]
    head += ["CPU s", "wall s", "peak MB", "gap error"]
    return _markdown(head, body)


def growth_factors(rows):
    """Growth of convolutions from half the size: {(code, size, cut_off): (geometric mean, worst)}.

    Half the size has the usual shortest wave in elements: with another cut-off, the same in mm.
    """
    counts = {(r["code"], r["size"], r["cut_off"], r["seed"]): r["convolutions"] for r in rows}
    factors = {}
    for of in dict.fromkeys((r["code"], r["size"], r["cut_off"]) for r in rows):
        code, size, _ = of
        ratios = [
            count / counts[code, size / 2, CUT_OFF, key[-1]]
            for key, count in counts.items()
            if key[:-1] == of and count and counts.get((code, size / 2, CUT_OFF, key[-1]))
        ]
        if ratios:
            factors[of] = (statistics.geometric_mean(ratios), max(ratios))
    return factors


def target_table(tables):  # noqa: C901, what it defines counts, too
    """What was to be reached, what was measured."""
    lines = []

    def line(what, asked, measured, met):
        lines.append([what, asked, measured, {True: "yes", False: "**no**", None: ""}[met]])

    def against(name, part, what, factor):
        rows = [r for r in tables[name] if r["reached"] == "yes"]
        own = [r for r in rows if r["code"] == OWN]
        peers = [r for r in rows if part in r["code"] and not r["code"].startswith("gstlib")]
        # As the registry installs them, unless another build is asked for.
        peers = [r for r in peers if ("native" in r["code"]) == ("native" in part)]
        if own and peers:
            peer = min(peers, key=lambda r: r["cpu_median"])
            ratio = peer["cpu_median"] / own[0]["cpu_median"]
            asked = f"≥ {factor}×" if factor else ""
            met = ratio >= factor if factor else None
            line(f"{what} ({peer['code']})", asked, f"{ratio:.1f}×", met)

    for name, where in (("rough-76", "76 MPa"), ("rough-22", "22 MPa")):
        against(name, "", f"Cold, {where}: fastest peer", 3)
        against(name, "aspher native", f"Cold, {where}: aspher for this processor", None)
        against(name, "slippy, BCCG", f"Cold, {where}", 5)
        against(name, "Tamaas", f"Cold, {where}", 20)
    for size in (256, 512):
        against(f"hertz-{size}", "", f"Sphere {size}²: fastest peer", 3)
        against(f"hertz-{size}", "slippy, BCCG", f"Sphere {size}²", 5)
        against(f"hertz-{size}", "Tamaas", f"Sphere {size}²", 20)
    for load in (76, 22):
        against(f"path-{load}", "", f"20 steps to {load} MPa: fastest peer", 5)
    for load in (76, 2000):
        against(f"periodic-{load}", "", f"Periodic, {load} MPa: fastest peer", None)
        against(f"periodic-{load}", "slippy, BCCG", f"Periodic, {load} MPa", None)
        against(f"periodic-{load}", "Tamaas", f"Periodic, {load} MPa", None)
    factors = growth_factors(tables["growth"])
    for (code, size, cut_off), (mean, worst) in factors.items():
        if code == OWN:
            waves = "" if cut_off == CUT_OFF else ", with the same waves"
            line(
                f"Convolutions from {size / 2:.0f}² to {size:.0f}²{waves}: mean over seeds",
                "≤ 1.25",
                f"{mean:.2f} (single surface {worst:.2f})",
                mean <= 1.25,
            )
    for row in tables["growth"]:
        of_first = row["seed"] == 0 and row["cut_off"] == CUT_OFF
        if row["code"] == OWN and row["size"] >= 2048 and of_first:
            line(
                f"{row['size']:.0f}²",
                "solved",
                f"{row['wall_median']:.0f} s, {row['peak_mb'] / 1e3:.2f} GB",
                row["reached"] == "yes",
            )
    return _markdown(["", "asked", "measured", "met"], lines)


def _count(value):
    return "" if value is None else f"{value:.0f}"


def _range(values):
    values = [value for value in values if value is not None]
    if not values:
        return ""
    low, high = min(values), max(values)
    return f"{low:.0f}" if low == high else f"{low:.0f}–{high:.0f}"


def _markdown(head, body):
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
