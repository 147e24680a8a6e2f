"""The look of every figure, the layout of its panels, and its files.

Matplotlib's constrained layout places the panels; each figure is as high as it needs. Colours are
safe for colour-blind readers: Okabe and Ito's for classes, perceptually uniform maps for numbers.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from gstlib.io.files import write_whole

DPI = 120
LEGIBLE = 26  # so many patches can be named side by side

BLACK, GREY, PALE = "#000000", "#7a7a7a", "#e4e4e4"
BLUE, VERMILION, AMBER, GREEN = "#0072B2", "#D55E00", "#E69F00", "#009E73"
PURPLE = "#882255"  # of Tol: theirs looks like blue to some readers
CLASSES = BLUE, VERMILION, AMBER, GREEN, PURPLE, BLACK  # whose names legends give
STONE = "#b9b2a6"
# How a predicted loss and the measured one agree, in the figures and on the page.
AGREEMENT = {
    "predicted and worn": BLUE,
    "worn but not predicted": AMBER,
    "predicted but not worn": PURPLE,
}

# Inches, of every figure: text has one size wherever figures are shown side by side.
WIDTH = 7.2

_STYLE = {
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same glyphs everywhere
    "font.size": 8,
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.constrained_layout.hspace": 0.0,
    "figure.constrained_layout.wspace": 0.0,
    "axes.titlesize": 8,
    "axes.titley": 1.0,  # searching for the best place takes longer than drawing
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.2,
    "figure.titlesize": 9,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "gstlib",
    "text.parse_math": False,  # names of files and patches may have dollar signs
}


# Decorates a drawing function: applies the house style, whatever the user's matplotlibrc says.
styled = matplotlib.style.context(["default", _STYLE])


@styled
def save_figure(
    figure: Figure,
    png: Path,
    vector: Path | None = None,
    *,
    source_note: str | None = None,
    layouts: "dict[tuple, Layout] | None" = None,
) -> None:
    """Write a figure as PNG and, if requested, as SVG or PDF; the same figure gives the same bytes.

    The files hold no date and no version of matplotlib, and each is complete or absent. A
    `source_note` is small print in the corner, which marks pictures of a synthetic specimen.
    `layouts` are kept from figure to figure: those of the same parts share one. To find a layout
    takes longer than to draw; it must not depend on the numbers that the figures show.
    """
    if source_note:
        look: dict[str, Any] = {"fontsize": 6.5, "color": GREY, "style": "italic"}
        figure.supxlabel(source_note, x=0.99, ha="right", **look)
    lay_out(figure, {} if layouts is None else layouts)
    # Level 2 packs these images almost as well as the default level, in a third of the time.
    options: dict[str, dict[str, Any]] = {
        "png": {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 2}},
        "svg": {"metadata": {"Date": None, "Creator": None}},
        "pdf": {"metadata": {"CreationDate": None, "Creator": None, "Producer": None}},
    }
    for path in (png, vector):
        if path is not None:
            content, kind = io.BytesIO(), path.suffix[1:].lower()
            figure.savefig(content, format=kind, **options[kind])
            write_whole(path, content.getvalue())


def panels(
    count: int, columns: int, aspect: float | None = None
) -> tuple[Figure, list[Axes]]:
    """A figure of equal panels, row by row.

    Panels are square, as maps are. Those of charts share out what axes and titles leave of the
    figure: `aspect` is the height over the width of their share.
    """
    rows = -(-count // columns)
    whole = rows * WIDTH / columns
    height = whole * aspect if aspect else whole + rows  # room for titles
    layout = "constrained" if aspect else "compressed"
    figure = Figure(figsize=(WIDTH, height), layout=layout)
    # The layout starts from wide panels: one that is narrower than its title shrinks further.
    place = {"left": 0.05, "right": 0.99, "wspace": 0, "hspace": 0}
    across = columns if aspect else min(count, columns)  # a row of few maps is centred
    grid = figure.add_gridspec(rows, across, **place)
    box = None if aspect else 1
    places = [grid[divmod(number, across)] for number in range(count)]
    return figure, [figure.add_subplot(place, box_aspect=box) for place in places]


class Layout(NamedTuple):
    """Size of a figure, and the places of its panels and texts."""

    size: tuple[float, float]
    panels: list[Bbox]
    texts: list[tuple[tuple[float, float], str]]  # with their vertical alignment


def lay_out(figure: Figure, layouts: dict[tuple, Layout]) -> None:
    """Place the parts of a figure as in the layout of its kind, which is found if it is new."""
    engine = figure.get_layout_engine()
    if engine is None:
        return
    bars = tuple(len(panel.child_axes) for panel in figure.axes)
    kind = bars, len(figure.texts), len(figure.legends)
    if kind not in layouts:
        engine.execute(figure)
        if any(panel.get_box_aspect() for panel in figure.axes):
            fit_height(figure)
            engine.execute(figure)
        layouts[kind] = Layout(
            tuple(figure.get_size_inches()),
            [panel.get_position() for panel in figure.axes],
            [(text.get_position(), text.get_va()) for text in figure.texts],
        )
    layout = layouts[kind]
    figure.set_layout_engine(None)  # for with any engine, each file takes two drawings
    figure.set_size_inches(layout.size)
    for panel, box in zip(figure.axes, layout.panels, strict=True):
        panel.set_position(box)
    for text, (place, alignment) in zip(figure.texts, layout.texts, strict=True):
        text.set(position=place, va=alignment)


def fit_height(figure: Figure) -> None:
    """Take off the height that the panels, and the texts above and below them, do not need."""
    boxes = [panel.get_tightbbox() for panel in figure.axes]
    top, bottom = max(box.y1 for box in boxes), min(box.y0 for box in boxes)
    texts = [*figure.texts, *figure.legends]
    around = sum(text.get_window_extent().height + 0.06 * DPI for text in texts)
    figure.set_size_inches(WIDTH, (top - bottom + around) / figure.dpi + 0.08)


def colour_legend(figure: Figure, colours: Mapping[str, str]) -> None:
    """A legend in one row under a figure, which names the `colours`."""
    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    look: dict[str, Any] = {"ncols": len(handles), "columnspacing": 1}
    figure.legend(handles=handles, loc="outside lower center", **look)


def write_beside(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    offset: tuple[float, float] = (2, 0),
    **look: Any,
) -> None:
    """Write small text beside a point of the data; `offset` in points."""
    place = {"xytext": offset, "textcoords": "offset points", "annotation_clip": False}
    axes.annotate(text, at, **({"fontsize": 6.5, "va": "center"} | place | look))


def write_all(
    axes: Axes, texts: Sequence[str], at: Sequence[tuple[float, float]], **look: Any
) -> None:
    """Write a text beside each of some points; where two would collide, the upper one moves up.

    The limits of the axes must be final; the panels are laid out. `look` has sequences, with a
    value for each text.
    """
    axes.figure.draw_without_rendering()
    width, height = 3.8 * max(map(len, texts), default=0), 7.0  # of a text, in points
    pixels = axes.transData.transform(np.asarray(at).reshape(-1, 2))
    across, up = pixels.T * 72 / axes.figure.dpi
    heights = up.copy()
    taken: list[int] = []
    for number in np.argsort(heights, kind="stable"):
        for other in sorted(taken, key=lambda one: heights[one]):
            aside = abs(across[number] - across[other]) >= width
            if not aside and abs(heights[number] - heights[other]) < height:
                heights[number] = heights[other] + height
        taken.append(int(number))
    for number, text in enumerate(texts):
        own = {name: values[number] for name, values in look.items()}
        offset = 3, heights[number] - up[number]
        write_beside(axes, text, at[number], offset, **own)


def short(value: float) -> str:
    """A number with three digits, as a reader writes it, without a power of ten."""
    return f"{float(f'{value:.3g}'):z.12g}".replace("-", "−")


def name_patches(axes: Axes, names: Sequence[str]) -> None:
    """Name the patches along x, one at each whole number; if there are many, every nth."""
    step = -(-len(names) // LEGIBLE) or 1
    axes.set_xticks(np.arange(0, len(names), step), list(names)[::step], fontsize=5.5)
    axes.margins(x=0.01)
    axes.set_xlabel("patch" if step == 1 else f"patch (every {step}th is named)")


@styled
def message_figure(sentence: str) -> Figure:
    """A figure with one sentence, for a study that has nothing to draw."""
    figure = Figure(figsize=(WIDTH, 1.0))
    figure.text(0.5, 0.55, sentence, ha="center", va="center", fontsize=9)
    return figure
