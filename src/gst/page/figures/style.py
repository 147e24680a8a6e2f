"""The look of every figure, the layout of its panels, and its files.

Panels are placed by hand, in inches: an automatic layout costs more time than the drawing. Colours
are safe for colour-blind readers: Okabe and Ito's for classes, perceptually uniform maps for
numbers.
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

from gstlib.io.files import write_whole

__all__ = ["AMBER", "BLACK", "BLUE", "CHARTS", "CLASSES", "DPI", "GREY", "LEGIBLE", "MAPS"]
__all__ += ["PALE", "PURPLE", "STONE", "VERMILION", "WIDTH", "colour_legend", "message_figure"]
__all__ += [
    "name_patches",
    "panels",
    "save_figure",
    "short",
    "styled",
    "write_all",
    "write_beside",
]

DPI = 120
LEGIBLE = 26  # so many patches can be named side by side

BLACK, GREY, PALE = "#000000", "#7a7a7a", "#e4e4e4"
BLUE, VERMILION, AMBER, GREEN = "#0072B2", "#D55E00", "#E69F00", "#009E73"
PURPLE = "#CC79A7"
CLASSES = BLUE, VERMILION, AMBER, GREEN, PURPLE, BLACK  # whose names legends give
STONE = "#b9b2a6"

# Room (inches) for titles and labels at the left, right, top and bottom of a panel.
MAPS = (0.05, 0.05, 0.4, 0.05)
CHARTS = (0.6, 0.15, 0.35, 0.45)
_FOOT = 0.2  # inches for the source note
WIDTH = (
    7.2  # inches, of every figure: text has one size wherever figures are shown side by side
)

_STYLE = {
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same glyphs everywhere
    "font.size": 8,
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
    figure: Figure, png: Path, vector: Path | None = None, *, source_note: str | None = None
) -> None:
    """Write a figure as PNG and, if requested, as SVG or PDF; the same figure gives the same bytes.

    The files hold no date and no version of matplotlib, and each is complete or absent. A
    `source_note` is small print in the corner, which marks pictures of a synthetic specimen.
    """
    if source_note:
        look: dict[str, Any] = {
            "fontsize": 6.5,
            "color": GREY,
            "style": "italic",
            "va": "bottom",
        }
        figure.text(0.99, 0.04 / figure.get_figheight(), source_note, ha="right", **look)
    # Level 2 packs these images almost as well as the default level, in a third of the time.
    options: dict[str, dict[str, Any]] = {
        "png": {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 2}},
        "svg": {"metadata": {"Date": None, "Creator": None}},
        "pdf": {"metadata": {"CreationDate": None, "Creator": None, "Producer": None}},
    }
    for path in (png, vector):
        if path is not None:
            content, kind = io.BytesIO(), path.suffix[1:]
            figure.savefig(content, format=kind, **options[kind])
            write_whole(path, content.getvalue())


def panels(
    count: int,
    columns: int,
    aspect: float = 1.0,
    room: tuple[float, float, float, float] = MAPS,
    *,
    head: float = 0.0,
) -> tuple[Figure, list[Axes]]:
    """A figure of equal panels, row by row; all lengths are in inches.

    Parameters
    ----------
    count, columns : int
        Number of panels, and the panels of a full row; a row with fewer is centred.
    aspect : float
        Height of a panel over its width.
    room : (left, right, top, bottom)
        Room around each panel.
    head : float
        Room at the top of the figure, for a title or a legend.
    """
    left, right, top, bottom = room
    cell = WIDTH / columns
    panel_width = cell - left - right
    panel_height = aspect * panel_width
    row_height = top + panel_height + bottom
    height = head + -(-count // columns) * row_height + _FOOT
    figure = Figure(figsize=(WIDTH, height))
    axes = []
    for row, column in (divmod(number, columns) for number in range(count)):
        absent = max(0, (row + 1) * columns - count)
        x = (column + absent / 2) * cell + left
        y = height - head - row * row_height - top - panel_height
        place = x / WIDTH, y / height, panel_width / WIDTH, panel_height / height
        axes.append(figure.add_axes(place))
    return figure, axes


def colour_legend(parent: Figure | Axes, colours: Mapping[str, str], **place: Any) -> None:
    """A legend in one row that names the `colours`; at the top of a figure by default."""
    handles = [Patch(color=colour, label=label) for label, colour in colours.items()]
    place = {"loc": "upper center", "ncols": len(handles), "columnspacing": 1} | place
    parent.legend(handles=handles, **place)


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

    The limits of the axes must be final. `look` has a sequence, of a value for each text, or none.
    """
    width, height = 3.8 * max(map(len, texts), default=0), 7.0  # of a text, in points
    places = axes.transData.transform(np.asarray(at).reshape(-1, 2)) * 72 / axes.figure.dpi
    heights = places[:, 1].copy()
    taken: list[int] = []
    for number in np.argsort(heights, kind="stable"):
        for other in sorted(taken, key=lambda one: heights[one]):
            aside = abs(places[number, 0] - places[other, 0]) >= width
            if not aside and abs(heights[number] - heights[other]) < height:
                heights[number] = heights[other] + height
        taken.append(int(number))
    for number, text in enumerate(texts):
        own = {name: values[number] for name, values in look.items()}
        write_beside(axes, text, at[number], (3, heights[number] - places[number, 1]), **own)


def short(value: float) -> str:
    """A number with three digits, as a reader writes it, without a power of ten."""
    return f"{float(f'{value:.3g}'):.12g}".replace("-", "−")


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
