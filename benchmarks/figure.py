"""The figure: CPU time of each code on each problem, and growth with the grid."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from problems import CUT_OFF
from report import OWN, by_time

PANELS = {
    "rough-76": "rough 512², 76 MPa",
    "periodic-76": "periodic, rough 512², 76 MPa",
    "hertz-512": "smooth sphere, 512²",
    "path-76": "20 steps to 76 MPa, rough 512²",
}
COLOURS = {
    "gstlib": "#c1272d",
    "aspher": "#1f4e79",
    "slippy": "#e08e0b",
    "ContactMechanics": "#3a7d44",
    "Tamaas": "#6b4c9a",
}
STYLE = {
    "font.size": 8,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
}


@matplotlib.rc_context(STYLE)
def draw(tables, path):
    """Write the figure from the tables of all cases."""
    figure, axes = plt.subplots(2, 3, figsize=(15, 7.6), layout="constrained")
    axes = axes.ravel()
    for axis, (name, title) in zip(axes, PANELS.items(), strict=False):
        _times(axis, tables[name], title)
    growth = tables["growth"]
    growth = growth[growth.cut_off == CUT_OFF]
    _growth(axes[4], growth, "convolutions", "finer grids, 76 MPa: convolutions")
    _growth(axes[5], growth, "cpu_median", "finer grids, 76 MPa: CPU time (s)")
    figure.suptitle(
        "CPU time, set-up and solve, one thread, every code at the same accuracy: gap within "
        "1e-9 of the r.m.s. height (open marks: never reached)"
    )
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def _colour(label):
    return COLOURS[label.split(",")[0]]


def _times(axis, table, title):
    """A line for each code: its time, and the ratio to ours or the error."""
    own = table.cpu_median[table.code == OWN].item()
    for row in by_time(table).itertuples():
        colour, text = _colour(row.code), f"  {row.cpu_median:.2g} s"
        if row.reached != "yes":
            text += f" (error {row.gap_error:.0e})"
        elif not row.code.startswith("gstlib"):
            text += f"  {row.cpu_median / own:.2g}×"
        face = colour if row.reached == "yes" else "white"
        axis.plot(row.cpu_median, row.code, "o", color=colour, markerfacecolor=face)
        axis.text(row.cpu_median, row.code, text, va="center")
    axis.set(title=title, xscale="log", xlabel="CPU time (s), and its ratio to ours")
    axis.set_xlim(right=9 * table.cpu_median.max())
    axis.invert_yaxis()


def _growth(axis, table, name, title):
    for label, rows in table.groupby("code", sort=False):
        colour = _colour(label)
        axis.plot(rows["size"], rows[name], ".", color=colour)
        axis.plot(rows.groupby("size")[name].mean(), color=colour, label=label)
    axis.set(title=title, xlabel="grid", xscale="log", yscale="log")
    sizes = table["size"].unique()
    axis.set_xticks(sizes, [f"{size}²" for size in sizes], minor=False)
    axis.xaxis.minorticks_off()
    axis.legend()
