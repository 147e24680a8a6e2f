"""How every figure looks, and how it is written.

Maps are drawn as one looks at the stone: the frame's origin is the reference corner at the top
right, x runs to the left and y downwards. Colours are colour-blind safe: Okabe and Ito's for
classes, perceptually uniform maps for numbers.
"""

import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import ParamSpec, TypeVar

import matplotlib
import matplotlib.style
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from gstlib.io.files import write_whole
from gstlib.surface import spacing_of

__all__ = [
    "AMBER",
    "BLUE",
    "CHANGE_MAP",
    "CONTACT",
    "FORCE_MAP",
    "GREY",
    "HEIGHT_MAP",
    "LEGIBLE",
    "MM_TO_UM",
    "PALE",
    "PRESSURE_MAP",
    "RELIEF_MAP",
    "VERMILION",
    "WIDTH",
    "block_of",
    "draw_classes",
    "draw_heights",
    "draw_map",
    "draw_mask",
    "height_limits",
    "legend_below",
    "name_patches",
    "new_figure",
    "save_figure",
    "scale_bar",
    "styled",
    "thickened_note",
    "write_notes",
]

P = ParamSpec("P")
R = TypeVar("R")

MM_TO_UM = 1e3
WIDTH = 7.2  # inches: a journal's double column
_DPI = 150
LEGIBLE = 60  # so many patches can be named beside each other

CONTACT, GREY, PALE = "#000000", "#7a7a7a", "#e4e4e4"
BLUE, VERMILION, AMBER = "#0072B2", "#D55E00", "#E69F00"

# So few levels that the files stay small, so many that the eye sees no steps.
HEIGHT_MAP = matplotlib.colormaps["cividis"].resampled(64)
CHANGE_MAP = matplotlib.colormaps["RdBu"].resampled(65)
# Light from end to end, so that black and the class colours stand out even over valleys.
RELIEF_MAP = LinearSegmentedColormap.from_list("relief", ["#9c9c9c", "#f8f8f8"], N=40)
# White at zero: no force is bare paper.
FORCE_MAP = LinearSegmentedColormap.from_list(
    "force", ["#ffffff", *matplotlib.colormaps["magma_r"](np.linspace(0.1, 0.95, 12))]
)
# Without the palest end, which a line on white would lose.
PRESSURE_MAP = LinearSegmentedColormap.from_list(
    "pressure", matplotlib.colormaps["viridis"](np.linspace(0, 0.88, 12))
)

_STYLE = {
    "figure.dpi": _DPI,
    "savefig.dpi": _DPI,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same glyphs everywhere
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
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
}


def _house_style() -> AbstractContextManager:
    return matplotlib.style.context(["default", _STYLE])


def styled(function: Callable[P, R]) -> Callable[P, R]:
    """Run a drawing function in the house style, whatever the user's matplotlibrc says."""
    return _house_style()(function)


@styled
def save_figure(figure: Figure, png: str | Path, svg: str | Path | None = None) -> None:
    """Write a figure as PNG and, if asked, as SVG; same figure, same bytes.

    Nothing of the clock or of matplotlib's version is written into the files, and each is whole
    or absent. The figure keeps the layout of its first file.
    """
    targets = [(Path(png), "png", {"Software": None})]
    if svg is not None:
        targets.append((Path(svg), "svg", {"Date": None, "Creator": None}))
    for path, kind, metadata in targets:
        drawn = io.BytesIO()
        figure.savefig(drawn, format=kind, metadata=metadata)
        write_whole(path, drawn.getbuffer())
        # Laying out takes longer than drawing, and both files are to look the same.
        figure.set_layout_engine("none")
        # Last digits of a layout differ from run to run, and an SVG names its clip paths by them.
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, 9))


def new_figure(width: float, height: float) -> Figure:
    """An empty figure (inches) that belongs to no window and lays itself out."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def write_notes(figure: Figure, source_note: str | None, notes: Iterable[str] = ()) -> None:
    """Small print under the figure: `notes` at the left, where the data comes from at the right."""
    left = " ".join(note for note in notes if note)
    if not left and not source_note:
        return
    room = 0.17 / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0, room, 1, 1 - room))
    style = {"fontsize": 6.5, "color": GREY, "va": "bottom"}
    at = 0.03 / figure.get_figheight()
    figure.text(0.008, at, left, ha="left", **style)
    figure.text(0.992, at, source_note or "", ha="right", style="italic", **style)


def name_patches(axes: Axes, names: Sequence[str], **style) -> None:
    """Name the patches along x, one for each whole number; of many, some in even steps."""
    step = math.ceil(len(names) / LEGIBLE) or 1
    axes.set_xticks(np.arange(0, len(names), step), list(names)[::step], **style)
    axes.set_xlabel("patch" if step == 1 else f"patch (every {step}th is named)")


def height_limits(*surfaces: xr.DataArray) -> tuple[float, float]:
    """Colour limits (µm) that several height maps (mm) share; the few extremes are cut off."""
    values = np.concatenate([surface.values[np.isfinite(surface.values)] for surface in surfaces])
    if not values.size:
        return -1.0, 1.0
    low, high = np.percentile(values, [0.5, 99.5]) * MM_TO_UM
    return (float(low), float(high)) if high > low else (float(low) - 1, float(high) + 1)


def draw_map(
    axes: Axes,
    field: xr.DataArray,
    values: np.ndarray,
    *,
    cmap,
    norm: Normalize | None = None,
    limits: tuple[float | None, float | None] = (None, None),
    interpolation: str = "auto",
    ticks: bool = True,
) -> AxesImage:
    """Draw `values` on the grid of `field`, origin at the top right; NaN stays pale."""
    dy, dx = spacing_of(field)
    left, right = float(field.x[0]) - dx / 2, float(field.x[-1]) + dx / 2
    top, bottom = float(field.y[0]) - dy / 2, float(field.y[-1]) + dy / 2
    scale = {"norm": norm} if norm is not None else {"vmin": limits[0], "vmax": limits[1]}
    image = axes.imshow(
        values,
        origin="lower",
        extent=(left, right, top, bottom),
        cmap=cmap,
        interpolation=interpolation,
        # in data, not in colours: a class or a limit never blends into another one
        interpolation_stage="data",
        **scale,
    )
    axes.set_xlim(right, left)
    axes.set_ylim(bottom, top)
    axes.set_facecolor(PALE)
    for spine in axes.spines.values():
        spine.set_visible(True)
    if ticks:
        axes.set_xlabel("x (mm)")
        axes.set_ylabel("y (mm)")
    else:
        axes.set_xticks([])
        axes.set_yticks([])
    return image


def draw_heights(
    axes: Axes,
    surface: xr.DataArray,
    *,
    relief: bool = False,
    limits: tuple[float, float] | None = None,
    ticks: bool = True,
) -> AxesImage:
    """Draw heights (mm, shown in µm), in colour or as a pale relief to put marks on."""
    return draw_map(
        axes,
        surface,
        surface.values * MM_TO_UM,
        cmap=RELIEF_MAP if relief else HEIGHT_MAP,
        limits=limits or height_limits(surface),
        ticks=ticks,
    )


def block_of(shape: tuple[int, int], panel_inches: float) -> int:
    """Elements to a side that one image pixel of a panel this wide must stand for."""
    return math.ceil(max(shape) / (panel_inches * _DPI))


def draw_mask(
    axes: Axes,
    field: xr.DataArray,
    mask: np.ndarray,
    colour: str,
    *,
    block: int = 1,
    thicken: bool = False,
) -> None:
    """Mark where `mask` holds, over what is drawn already.

    An image pixel that stands for a `block` of elements is as opaque as the share of them that is
    marked. With `thicken` it is marked whole if any of them is, so that a spot of one element
    does not fade away; say so under the figure.
    """
    count = _count_in_blocks(mask, block)
    painted = np.empty((*count.shape, 4))
    painted[..., :3] = to_rgb(colour)
    painted[..., 3] = count > 0 if thicken else count / block**2
    _lay_over(axes, field, painted, block)


def draw_classes(
    axes: Axes, field: xr.DataArray, classes: Mapping[str, np.ndarray], *, block: int = 1
) -> None:
    """Mark masks that exclude each other, by colour, over what is drawn already.

    An image pixel that stands for a `block` of elements is marked if any of them is, in the
    colour of most of them: spots of one element do not fade away, as with `thicken` of `draw_mask`.
    """
    counts = np.stack([_count_in_blocks(mask, block) for mask in classes.values()])
    painted = np.empty((*counts.shape[1:], 4))
    painted[..., :3] = np.array([to_rgb(colour) for colour in classes])[counts.argmax(axis=0)]
    painted[..., 3] = counts.any(axis=0)
    _lay_over(axes, field, painted, block)


def _count_in_blocks(mask: np.ndarray, block: int) -> np.ndarray:
    """How many elements of each block are marked; the last blocks may stick out of the mask."""
    mask = np.asarray(mask, dtype=bool)
    ny, nx = (-(-n // block) * block for n in mask.shape)
    padded = np.zeros((ny, nx), dtype=bool)
    padded[: mask.shape[0], : mask.shape[1]] = mask
    return padded.reshape(ny // block, block, nx // block, block).sum(axis=(1, 3))


def _lay_over(axes: Axes, field: xr.DataArray, painted: np.ndarray, block: int) -> None:
    """Show an image of blocks (rows, columns, RGBA) on the grid of `field`."""
    dy, dx = spacing_of(field)
    left, top = float(field.x[0]) - dx / 2, float(field.y[0]) - dy / 2
    rows, columns = painted.shape[:2]
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(
        painted,
        origin="lower",
        extent=(left, left + columns * block * dx, top, top + rows * block * dy),
        interpolation="nearest",
    )
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def thickened_note(block: int) -> str:
    """What to write under maps whose marks were thickened to be seen."""
    if block == 1:
        return ""
    return f"Contact is drawn at least {block} elements wide, so that no spot is lost."


def legend_below(axes: Axes, handles: Sequence[Artist], *, columns: int | None = None) -> None:
    """A legend in one row (or in `columns`) right under a map without ticks."""
    axes.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.01),
        ncols=columns or len(handles),
        handlelength=1,
        columnspacing=1,
        fontsize=6.5,
    )


def scale_bar(axes: Axes, length_mm: float) -> None:
    """A bar of known length in the lower left corner, in place of ticks."""
    right, left = sorted(axes.get_xlim())
    top, bottom = sorted(axes.get_ylim())
    at_x, at_y = left - 0.06 * (left - right), bottom - 0.07 * (bottom - top)
    axes.plot([at_x, at_x - length_mm], [at_y, at_y], color="black", lw=2, solid_capstyle="butt")
    axes.text(
        at_x - length_mm / 2,
        at_y - 0.02 * (bottom - top),
        f"{length_mm:g} mm",
        ha="center",
        va="bottom",
        fontsize=6.5,
        bbox={"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.8},
    )
