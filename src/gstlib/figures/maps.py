"""Maps: heights, forces and marked elements, with a scale bar and a colour bar.

Maps are drawn as one looks at the stone, in the square's own axes: x runs to the right and y
upwards from the reference corner, at the lower left. A pixel of a panel shows the mean of the
elements under it: marks cover as much of the picture as of the surface.
"""

import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, PowerNorm, to_rgb
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from gstlib.figures.style import DPI, MM_TO_UM, PALE, VERMILION
from gstlib.surface import spacing_of

__all__ = ["CHANGE_MAP", "FORCE_MAP", "HEIGHT_MAP", "OUTLINE", "colour_bar", "draw_footprints"]
__all__ += ["draw_forces", "draw_heights", "draw_map", "height_norm", "mark_corner", "pixel_means"]
__all__ += ["scale_bar"]

# Few levels make small files; these are enough that the eye sees no steps.
HEIGHT_MAP = colormaps["cividis"].resampled(64)
CHANGE_MAP = colormaps["RdBu"].resampled(65)
# Light from end to end: black and the class colours stand out even over valleys.
RELIEF_MAP = LinearSegmentedColormap.from_list("relief", ["#c4c4c4", "#fafafa"], N=40)
# White at zero: no force is bare paper.
FORCE_MAP = LinearSegmentedColormap.from_list(
    "force", ["#ffffff", *colormaps["magma_r"](np.linspace(0.1, 0.95, 12))]
)
OUTLINE = [withStroke(linewidth=2.5, foreground="white")]


def height_norm(*surfaces: xr.DataArray) -> Normalize:
    """Colour limits (µm) that height maps (mm) share; the most extreme 1 % is cut off."""
    values = np.concatenate([surface.values[np.isfinite(surface.values)] for surface in surfaces])
    low, high = np.percentile(values, [0.5, 99.5]) * MM_TO_UM if values.size else (-1.0, 1.0)
    return Normalize(low, high) if high > low else Normalize(low - 1, high + 1)


def pixel_means(values: np.ndarray, pixels: int) -> np.ndarray:
    """Means over the pixels of a panel, each element in exactly one; NaN where none is known.

    Parameters
    ----------
    values : (ny, nx) ndarray
        Numbers, NaN where unknown, or a mask.
    pixels : int
        Pixels along the longer side. A coarser grid is kept as it is.
    """
    longest = max(values.shape)
    if longest <= pixels:
        return values.astype(float)
    counts = [max(1, round(pixels * n / longest)) for n in values.shape]
    # The first element under each pixel, along y and along x.
    rows, columns = (
        -(-np.arange(count) * n // count) for count, n in zip(counts, values.shape, strict=True)
    )

    def sums(of: np.ndarray) -> np.ndarray:
        return np.add.reduceat(np.add.reduceat(of, rows, axis=0), columns, axis=1)

    known = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        return sums(np.where(known, values, 0.0)) / sums(known.astype(float))


def draw_map(
    axes: Axes,
    field: xr.DataArray,
    values: np.ndarray | None = None,
    *,
    cmap: Colormap = RELIEF_MAP,
    norm: Normalize | None = None,
    marks: Mapping[str, np.ndarray] | None = None,
    ticks: bool = False,
) -> ScalarMappable:
    """Draw a field on its grid, with marked elements over it.

    Parameters
    ----------
    axes : matplotlib Axes
        A panel of the final size: the picture has its pixels.
    field : (y, x) xarray.DataArray
        The grid; heights in mm, drawn in µm unless there are `values`.
    values : (ny, nx) ndarray, optional
        What to draw instead. NaN stays pale.
    cmap, norm
        Colours, by default a pale relief between the limits of the heights.
    marks : mapping of colour to (ny, nx) mask, optional
        Elements to paint over; the masks exclude each other.
    ticks : bool
        Draw axes in mm; without them, add a `scale_bar`.

    Returns
    -------
    matplotlib.cm.ScalarMappable
        For a `colour_bar`.
    """
    inches = axes.get_position(original=True).size * axes.figure.get_size_inches()
    pixels = round(float(min(inches)) * DPI)
    norm = norm or height_norm(field)
    means = pixel_means(field.values * MM_TO_UM if values is None else values, pixels)
    picture = cmap(norm(np.ma.masked_invalid(means)))[..., :3]
    picture[np.isnan(means)] = to_rgb(PALE)
    if marks:
        shares = [pixel_means(mask, pixels)[..., np.newaxis] for mask in marks.values()]
        picture *= 1 - sum(shares)
        for share, colour in zip(shares, marks, strict=True):
            picture += share * np.array(to_rgb(colour))
    dy, dx = spacing_of(field)
    left, right = float(field.x[0]) - dx / 2, float(field.x[-1]) + dx / 2
    bottom, top = float(field.y[0]) - dy / 2, float(field.y[-1]) + dy / 2
    axes.imshow(
        np.round(255 * picture.clip(0, 1)).astype(np.uint8),
        origin="lower",
        extent=(left, right, bottom, top),
        interpolation="nearest",
    )
    axes.set(xlim=(left, right), ylim=(bottom, top))
    if ticks:
        axes.set(xlabel="x (mm)", ylabel="y (mm)")
    else:
        axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(True)
    return ScalarMappable(norm, cmap)


def draw_heights(axes: Axes, height: xr.DataArray) -> None:
    """Draw heights (mm) in colours, with axes in mm and a colour bar."""
    image = draw_map(axes, height, cmap=HEIGHT_MAP, norm=height_norm(height), ticks=True)
    colour_bar(axes, image, "height (µm)", below=0.13)


def draw_forces(axes: Axes, contact: xr.Dataset, *, ticks: bool = False) -> ScalarMappable:
    """Force (N) on each element at the last step, in colours on a square-root scale."""
    dy, dx = spacing_of(contact)
    force = contact["pressure"].values[-1] * dy * dx
    norm = PowerNorm(0.5, vmin=0, vmax=float(force.max()) or 1.0)
    return draw_map(axes, contact["height"], force, cmap=FORCE_MAP, norm=norm, ticks=ticks)


def scale_bar(axes: Axes) -> None:
    """A bar of a round length, about a quarter of a map, in its lower left corner."""
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    length = float(f"{0.24 * (right - left):.0e}")
    x, y = left + 0.06 * (right - left), bottom + 0.07 * (top - bottom)
    # longer than the bar, or its ends would vanish on black contact
    outline = [withStroke(linewidth=4, foreground="white", capstyle="projecting")]
    look = {"color": "black", "lw": 2, "solid_capstyle": "butt", "path_effects": outline}
    axes.plot([x, x + length], [y, y], **look)
    middle = x + length / 2, y + 0.025 * (top - bottom)
    look = {"ha": "center", "va": "bottom", "fontsize": 6.5, "path_effects": OUTLINE}
    axes.text(*middle, f"{length:g} mm", **look)


def mark_corner(axes: Axes) -> None:
    """Mark the reference corner, from which the patch table counts."""
    low, high = axes.get_xlim()
    side = 0.05 * (high - low)
    corner = np.add([[0, 0], [side, 0], [0, side]], (low, axes.get_ylim()[0]))
    axes.add_patch(Polygon(corner, color=VERMILION, linewidth=0))
    axes.set_title("◣ reference corner", loc="left", color=VERMILION, fontsize=7)


def colour_bar(axes: Axes, colours: ScalarMappable, label: str, *, below: float = 0.04) -> None:
    """What the colours of a map stand for, at a distance `below` it (in its heights).

    The strip names its ends only: ticks would take longer to draw than the map.
    """
    strip = AxesImage(axes, extent=(0.25, 0.75, -below - 0.035, -below), transform=axes.transAxes)
    strip.set_data(colours.cmap(np.linspace(0, 1, 64))[np.newaxis])
    axes.add_artist(strip)
    strip.set_clip_on(False)
    low, high = (f"{end:.3g}".replace("-", "−") for end in (colours.norm.vmin, colours.norm.vmax))
    for x, y, text, align in (
        (0.23, -below - 0.0175, low, "right"),
        (0.77, -below - 0.0175, high, "left"),
        (0.5, -below - 0.075, label, "center"),
    ):
        place = {"ha": align, "va": "center", "transform": axes.transAxes}
        axes.text(x, y, text, fontsize=6.5, **place)


def draw_footprints(
    axes: Axes, patches: pd.DataFrame, patch_size_mm: float, *, colour: str
) -> None:
    """Outline and name the patches: solid in the study, dashed out of it.

    Parameters
    ----------
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm``, optionally ``rotation_deg`` and ``in_study``.
    patch_size_mm : float
        Side of a patch.
    """
    half = patch_size_mm / 2
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    for row in patches.itertuples(index=False):
        turn = math.radians(getattr(row, "rotation_deg", 0.0))
        turned = corners @ [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
        outline = Polygon(np.add(turned, (row.x_mm, row.y_mm)), fill=False, edgecolor=colour)
        line = "-" if getattr(row, "in_study", True) else "--"
        outline.set(linestyle=line, path_effects=OUTLINE)
        axes.add_patch(outline)
        at = row.x_mm - 0.92 * half, row.y_mm + 0.9 * half
        look = {"fontsize": 6.5, "color": colour, "path_effects": OUTLINE}
        axes.text(*at, row.patch, ha="left", va="top", **look)
