"""The look of every figure, the layout of its panels, and its files.

`style.mplstyle`, beside this module, is the look of text, lines and axes. Matplotlib's constrained
layout places the panels; each figure is as high as it needs. Colours are safe for colour-blind
readers: Okabe and Ito's for classes, perceptually uniform maps for numbers.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.text import Annotation

from gstlib.io.files import write_whole

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
_LEGIBLE = 26  # so many patches can be named side by side
_TEXT_HEIGHT = 7.0  # points, of small text beside points of the data
# Of a file, what tells when and by which version of matplotlib it was made.
_ORIGIN = {
    "png": ["Software"],
    "svg": ["Date", "Creator"],
    "pdf": ["CreationDate", "Creator", "Producer"],
}

# Decorates a drawing function: applies the house style, whatever the user's matplotlibrc says.
_LOOK = Path(__file__).with_suffix(".mplstyle")
styled = matplotlib.style.context(["default", _LOOK])


@styled
def save_figure(
    figure: Figure,
    png: Path,
    vector: Path | None = None,
    *,
    source_note: str | None = None,
    layouts: dict[tuple, Figure] | None = None,
) -> None:
    """Write a figure as PNG and, if requested, as SVG or PDF; the same figure gives the same bytes.

    The files hold no date and no version of matplotlib, and each is complete or absent. A
    `source_note` is small print in the corner, which marks pictures of a synthetic specimen.
    `layouts` are kept from figure to figure: those of the same parts share one. To find a layout
    takes longer than to draw; it must not depend on the numbers that the figures show.
    """
    if source_note:
        note = figure.supxlabel(source_note, x=0.99, ha="right")
        note.set(fontsize=6.5, color=GREY, style="italic")
    lay_out(figure, {} if layouts is None else layouts)
    for path in filter(None, (png, vector)):
        content, kind = io.BytesIO(), path.suffix[1:].lower()
        # Level 2 packs these images almost as well as the default, in a third of the time.
        packing: Any = {"pil_kwargs": {"compress_level": 2}} if kind == "png" else {}
        origin = dict.fromkeys(_ORIGIN[kind])
        figure.savefig(content, format=kind, metadata=origin, **packing)
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
    across = columns if aspect else min(count, columns)  # a row of few maps is centred
    # The layout starts from wide panels: one that is narrower than its title shrinks further.
    grid = figure.add_gridspec(rows, across, left=0.05, right=0.99, wspace=0, hspace=0)
    box = None if aspect else 1
    places = [grid[divmod(number, across)] for number in range(count)]
    return figure, [figure.add_subplot(place, box_aspect=box) for place in places]


def lay_out(figure: Figure, layouts: dict[tuple, Figure]) -> None:
    """Place the parts of a figure as in the first figure of its kind, which is laid out."""
    if (engine := figure.get_layout_engine()) is None:
        return
    bars = tuple(len(panel.child_axes) for panel in figure.axes)
    kind = bars, len(figure.texts), len(figure.legends)
    if kind not in layouts:
        layouts[kind] = figure
        engine.execute(figure)
        if figure.axes[0].get_box_aspect():
            fit_height(figure)
            engine.execute(figure)
        for panel in figure.axes:
            panel.set_position(panel.get_position())
    first = layouts[kind]
    figure.set_layout_engine(None)  # for with any engine, each file takes two drawings
    figure.set_size_inches(first.get_size_inches())
    for panel, placed in zip(figure.axes, first.axes, strict=True):
        panel.set_position(placed.get_position(original=True))
    for text, written in zip(figure.texts, first.texts, strict=True):
        text.set(position=written.get_position(), va=written.get_va())


def fit_height(figure: Figure) -> None:
    """Take off the height that the panels, and the texts above and below them, do not need."""
    boxes = [panel.get_tightbbox() for panel in figure.axes]
    height = max(box.y1 for box in boxes) - min(box.y0 for box in boxes)
    for text in [*figure.texts, *figure.legends]:
        height += text.get_window_extent().height + 0.06 * figure.dpi
    figure.set_size_inches(WIDTH, height / figure.dpi + 0.08)


def colour_legend(figure: Figure, colours: Mapping[str, str]) -> None:
    """A legend in one row under a figure, which names the `colours`."""
    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=len(handles), columnspacing=1
    )


def write_beside(
    axes: Axes,
    text: str,
    at: Any,
    offset: tuple[float, float],
    va: str = "center",
    **look: Any,
) -> Annotation:
    """Write small text beside a point of the data; `offset` in points."""
    return axes.annotate(
        text,
        at,
        xytext=offset,
        textcoords="offset points",
        annotation_clip=False,
        fontsize=6.5,
        va=va,
        **look,
    )


def write_all(
    axes: Axes,
    texts: Sequence[str],
    at: Sequence[tuple[float, float]],
    colours: Sequence[Any],
) -> None:
    """Write a text beside each of some points; where two would collide, the upper one moves up.

    The limits of the axes must be final; the panels are laid out.
    """
    axes.figure.draw_without_rendering()
    pixels = axes.transData.transform(np.reshape(at, (-1, 2)))
    across, up = pixels.T * 72 / axes.figure.dpi  # points
    width = 3.8 * max(map(len, texts), default=0)
    taken: list[tuple[float, float]] = []  # height, and place across
    for number in np.argsort(up, kind="stable"):
        height = up[number]
        for other, beside in sorted(taken):
            is_beside = abs(across[number] - beside) < width
            if is_beside and abs(height - other) < _TEXT_HEIGHT:
                height = other + _TEXT_HEIGHT
        taken.append((height, across[number]))
        offset = 3, height - up[number]
        write_beside(axes, texts[number], at[number], offset, color=colours[number])


def short(value: float) -> str:
    """A number with three digits, as a reader writes it, without a power of ten."""
    return f"{float(f'{value:.3g}'):z.12g}".replace("-", "−")


def name_patches(axes: Axes, names: Sequence[str]) -> None:
    """Name the patches along x, one at each whole number; if there are many, every nth."""
    step = -(-len(names) // _LEGIBLE) or 1
    axes.set_xticks(np.arange(0, len(names), step), list(names)[::step], fontsize=5.5)
    axes.margins(x=0.01)
    axes.set_xlabel("patch" if step == 1 else f"patch (every {step}th is named)")


@styled
def message_figure(sentence: str) -> Figure:
    """A figure with one sentence, for a study that has nothing to draw."""
    figure = Figure(figsize=(WIDTH, 1.0))
    figure.text(0.5, 0.55, sentence, ha="center", va="center", fontsize=9)
    return figure
