"""Maps: heights, forces and marked elements, with a scale bar and a colour bar.

Maps show the stone from outside, in the square's own axes: x runs to the right and y upwards from
the reference corner, at the lower left. A pixel of a panel has the mean colour of the elements
under it: marks cover the same share of the picture as of the surface.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import (
    Colormap,
    LinearSegmentedColormap,
    ListedColormap,
    Normalize,
    PowerNorm,
    to_rgb,
)
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import withStroke
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from gst.page.figures.style import PALE, VERMILION, panels, short, write_beside
from gstlib.surfaces.footprints import outline, places_of
from gstlib.surfaces.grid import MM_TO_UM, spacing_of

# Few levels make small files; with these, the eye sees no steps.
HEIGHT_MAP = colormaps["cividis"].resampled(64)
CHANGE_MAP = colormaps["RdBu"].resampled(65)
LOSS_MAP = ListedColormap(CHANGE_MAP(np.arange(33)))  # its half, up to white
# Light throughout: black and the class colours stand out even over valleys.
RELIEF_MAP = LinearSegmentedColormap.from_list("relief", ["#c4c4c4", "#fafafa"], N=40)
# Slopes of stone are gentle: under a raking light they are shown so many times as steep.
_STEEPER = 2.0
# White at zero: bare paper means no force.
FORCE_MAP = LinearSegmentedColormap.from_list(
    "force", ["#ffffff", *colormaps["magma_r"](np.linspace(0.1, 0.95, 12))]
)
OUTLINE = [withStroke(linewidth=2.5, foreground="white")]


def height_colours(
    *surfaces: xr.DataArray, cmap: Colormap = HEIGHT_MAP
) -> ScalarMappable:
    """Colours that height maps (µm) share; the most extreme 1 % is cut off."""
    values = np.concatenate([surface.values.ravel() for surface in surfaces])
    low, high = np.nanpercentile(values, [0.5, 99.5])
    return ScalarMappable(Normalize(low, high), cmap)


def force_colours(field: xr.DataArray) -> ScalarMappable:
    """Colours of forces or pressures, on a square-root scale from 0 to the largest."""
    highest = float(field.max()) or 1.0
    return ScalarMappable(PowerNorm(0.5, vmin=0, vmax=highest), FORCE_MAP)


class Map(NamedTuple):
    """A field on its grid, as it is drawn."""

    title: str
    field: xr.DataArray  # (y, x); NaN stays pale
    # of the numbers of the field; by default a pale relief, whatever their unit
    colours: ScalarMappable | None = None
    # masks (y, x) of elements to paint over, by colour; they exclude each other
    marks: Mapping[str, Any] = {}
    bar: str = ""  # what the colours mean, for a colour bar under the map


def draw_maps(maps: Sequence[Map], columns: int) -> Figure:
    """Small multiples, with a scale bar."""
    figure, axes = panels(len(maps), columns)
    for panel, one in zip(axes, maps, strict=True):
        draw_map(panel, *one[1:])
        panel.set_title(one.title, fontsize=7)
    scale_bar(axes[0])
    return figure


def draw_map(
    axes: Axes,
    field: xr.DataArray,
    colours: ScalarMappable | None = None,
    marks: Mapping[str, Any] = {},
    bar: str = "",
    *,
    ticks: bool = False,
) -> None:
    """Draw a field; the arguments are those of a `Map`. With `ticks`, the axes are in mm."""
    picture = picture_of(field, colours, marks)
    shown = xr.DataArray(picture, {"y": field.y, "x": field.x}, ("y", "x", "rgb"))
    # where elements are smaller than pixels, a pixel has their mean colour
    shown.plot.imshow(ax=axes, add_labels=False, interpolation="antialiased")
    axes.set_aspect("equal")
    if ticks:
        axes.set(xlabel="x (mm)", ylabel="y (mm)")
    else:
        axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(True)
    if bar and colours:
        _draw_bar(axes, colours, bar, 0.13 if ticks else 0.04)


def _draw_bar(axes: Axes, colours: ScalarMappable, text: str, below: float) -> None:
    """A colour bar so far `below` a map, in heights of the map, with its ends named."""
    strip = axes.inset_axes((0.2, -below - 0.035, 0.6, 0.035))
    bar = axes.figure.colorbar(
        colours,
        cax=strip,
        orientation="horizontal",
        ticks=colours.get_clim(),
        format=lambda value, _: short(value),
    )
    bar.outline.set_visible(False)
    strip.tick_params(length=0, labelsize=6.5, pad=1)
    strip.set_xlabel(text, fontsize=6.5, labelpad=1)


def picture_of(
    field: xr.DataArray,
    colours: ScalarMappable | None = None,
    marks: Mapping[str, Any] = {},
) -> np.ndarray:
    """What `draw_map` draws: (ny, nx, 3), uint8; its first row is that of the field."""
    colours = colours or height_colours(field, cmap=RELIEF_MAP)
    picture = colours.to_rgba(field.values, bytes=True)[..., :3]
    return _painted(picture, {PALE: field.isnull(), **marks})


def raking(height: xr.DataArray) -> np.ndarray:
    """Heights (mm) lit from the upper left; as `picture_of`."""
    # Not by matplotlib's LightSource, which stretches the brightness of each picture by itself: two
    # could not be compared.
    level = height.fillna(height.mean().fillna(0)).values  # where nothing is measured
    slope_y, slope_x = np.gradient(_STEEPER * level, *spacing_of(height))
    steepness = np.sqrt(1 + slope_y**2 + slope_x**2)
    towards = (slope_x - slope_y + np.sqrt(2)) / 2 / steepness
    grey = np.round(255 * towards.clip(0, 1)).astype(np.uint8)
    return _painted(np.stack(3 * [grey], axis=-1), {PALE: height.isnull()})


def _painted(picture: np.ndarray, marks: Mapping[str, Any]) -> np.ndarray:
    for colour, mask in marks.items():
        picture[np.asarray(mask, bool)] = np.round(255 * np.array(to_rgb(colour)))
    return picture


def draw_heights(axes: Axes, height: xr.DataArray, **look: Any) -> None:
    """Heights (mm) in colours, with a bar and axes in mm."""
    height = height * MM_TO_UM
    colours = height_colours(height)
    draw_map(axes, height, colours, bar="height (µm)", ticks=True, **look)


def draw_forces(axes: Axes, contact: xr.Dataset, **look: Any) -> None:
    """Force (N) on each element at the last step, in colours on a square-root scale."""
    force = contact.pressure * np.prod(spacing_of(contact))
    draw_map(axes, force, force_colours(force), **look)


def scale_bar(axes: Axes) -> None:
    """A bar of a round length, about a quarter of a map, in its lower left corner."""
    length = float(f"{0.24 * np.diff(axes.get_xlim()).item():.0e}")
    bar = AnchoredSizeBar(
        axes.transData,
        length,
        f"{length:g} mm",
        "lower left",
        label_top=True,
        size_vertical=0,
        fontproperties=FontProperties(size=6.5),
    )
    bar.patch.set(linewidth=0, alpha=0.8)  # white, so that it shows on black contact
    axes.add_artist(bar)


def mark_corner(axes: Axes) -> None:
    """Mark the reference corner, from which the patch table measures."""
    low, high = axes.get_xlim()
    side = 0.05 * (high - low)
    corner = np.add([[0, 0], [side, 0], [0, side]], (low, axes.get_ylim()[0]))
    axes.add_patch(Polygon(corner, color=VERMILION, linewidth=0))
    axes.set_title("◣ reference corner", loc="left", color=VERMILION, fontsize=7)


def outline_square(axes: Axes, size_mm: float) -> None:
    """Outline the square in a map of the face."""
    axes.add_patch(Rectangle((0, 0), size_mm, size_mm, fill=False, edgecolor=VERMILION))


def draw_footprints(
    axes: Axes, patches: pd.DataFrame, patch_mm: float, *, colour: str
) -> None:
    """Outline and name the patches: solid if in the study, else dashed; graded ones "name: grade".

    `patches` has ``patch, x_mm, y_mm, rotation_deg`` and optionally ``in_study``, ``wear_grade``.
    """
    names = patches.patch.astype(str)
    if "wear_grade" in patches:
        graded = names + ": " + patches.wear_grade.map("{:g}".format)
        names = names.where(patches.wear_grade.isna(), graded)
    studied = patches.get("in_study", pd.Series(True, patches.index))
    places = places_of(patches).values()
    look = {"color": colour, "path_effects": OUTLINE}
    for place, name, is_studied in zip(places, names, studied, strict=True):
        corners = outline(place, patch_mm)
        line = "-" if is_studied else "--"
        axes.add_patch(Polygon(corners, fill=False, linestyle=line, **look))
        write_beside(axes, name, label_in(corners), (2, -2), va="top", **look)


def label_in(corners: np.ndarray) -> np.ndarray:
    """Where the name of a patch begins: its upper left corner, however it is turned."""
    return corners[np.argmax(np.diff(corners, axis=1))]
