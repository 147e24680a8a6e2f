"""The figure: CPU time of each code on each problem, and growth with the grid."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd
from problems import CUT_OFF

PANELS = (
    ("rough-76", "rough 512², 76 MPa"),
    ("periodic-76", "periodic, rough 512², 76 MPa"),
    ("hertz-512", "smooth sphere, 512²"),
    ("path-76", "20 steps to 76 MPa, rough 512²"),
)
COLOURS = {
    "gstlib": "#c1272d",
    "aspher": "#1f4e79",
    "slippy": "#e08e0b",
    "ContactMechanics": "#3a7d44",
    "Tamaas": "#6b4c9a",
}
OWN = "gstlib, load"


def draw(tables, path):
    """Write the figure from the tables of report.read_table; panels without results stay empty."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 7.6), layout="constrained")
    axes = axes.ravel()
    labels = _labels([tables[name] for name, _ in PANELS[:3]])
    for index, (name, title) in enumerate(PANELS):
        own = labels if index < 3 else _labels([tables[name]])
        _times(axes[index], tables[name], title, own, named=index in (0, 3))
    _growth(
        axes[4], tables["growth"], "convolutions", "finer grids, 76 MPa: convolutions"
    )
    _growth(
        axes[5], tables["growth"], "cpu_median", "finer grids, 76 MPa: CPU time (s)"
    )
    figure.suptitle(
        "CPU time, set-up and solve, one thread, every code at the same accuracy: gap within "
        "1e-9 of the r.m.s. height (open marks: never reached)",
        x=0.01,
        ha="left",
        fontsize=11,
    )
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def _colour(label):
    return COLOURS[label.replace(",", " ").split()[0]]


def _labels(tables):
    """Codes, ours first, then the cheapest of the first table on top."""
    labels = {}  # in order
    for rows in tables:
        for row in sorted(
            rows, key=lambda row: (row["reached"] != "yes", row["cpu_median"])
        ):
            labels.setdefault(row["code"])
    return sorted(labels, key=lambda label: not label.startswith("gstlib"))


def _text(row, own):
    """The time of a code, and its ratio to ours or its error."""
    text = f"{row['cpu_median']:.2g} s"
    ratio = row["cpu_median"] / (own or 1)
    if row["reached"] != "yes":
        return f"{text} (error {row['gap_error']:.0e})"
    if not own or row["code"].startswith("gstlib"):
        return text
    return f"{text}  {ratio:.0f}×" if ratio >= 10 else f"{text}  {ratio:.1f}×"


def _times(axis, rows, title, labels, named):
    axis.set_title(title, fontsize=10, loc="left")
    own = next((row["cpu_median"] for row in rows if row["code"] == OWN), None)
    for row in rows:
        height = labels.index(row["code"])
        colour = _colour(row["code"])
        at = row["cpu_median"], height
        face = colour if row["reached"] == "yes" else "white"
        axis.axhline(height, color="0.92", linewidth=0.8, zorder=0)
        axis.plot(*at, "o", color=colour, markersize=7, markerfacecolor=face)
        beside = {"xytext": (7, 0), "textcoords": "offset points", "va": "center"}
        axis.annotate(_text(row, own), at, fontsize=8, **beside)
    times = [row["cpu_median"] for row in rows] or [1]
    axis.set(xscale="log", xlim=(min(times) / 1.6, max(times) * 9))
    axis.set_ylim(len(labels) - 0.5, -0.5)
    axis.set_yticks(range(len(labels)), labels if named else [], fontsize=8.5)
    axis.tick_params(axis="y", length=0)
    axis.tick_params(axis="x", labelsize=8)
    axis.xaxis.set_major_formatter("{x:g}")
    axis.set_xlabel("CPU time (s), and its ratio to gstlib's under load", fontsize=8.5)
    axis.spines[["top", "right", "left"]].set_visible(False)


def _growth(axis, rows, key, title):
    axis.set_title(title, fontsize=10, loc="left")
    axis.set(xscale="log", yscale="log")
    rows = pd.DataFrame([row for row in rows if row[key] and row["cut_off"] == CUT_OFF])
    if rows.empty:
        return
    for label, own in rows.groupby("code", sort=False):
        means = own.groupby("size")[key].mean()
        axis.plot(means, "o-", ms=3.5, linewidth=1.4, label=label, color=_colour(label))
        axis.plot(own["size"], own[key], "o", ms=3.5, color=_colour(label))
    axis.legend(fontsize=8.5, frameon=False, loc="upper left")
    sizes = sorted(set(rows["size"]))
    axis.set_xticks(sizes, [f"{n:.0f}²" for n in sizes], fontsize=8)
    axis.minorticks_off()
    if key == "convolutions":
        counts = [20, 50, 100, 200, 500]
        axis.set_yticks(counts, counts)
        axis.set_ylim(15, 600)
    else:
        axis.yaxis.set_major_formatter("{x:g}")
    axis.tick_params(axis="y", labelsize=8)
    axis.set_xlabel("grid", fontsize=8.5)
    axis.grid(alpha=0.25)
    axis.spines[["top", "right"]].set_visible(False)
