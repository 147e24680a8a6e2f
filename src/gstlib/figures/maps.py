"""Maps: heights, forces and marked elements, with a scale bar and a colour bar.

Maps are drawn as one looks at the stone, in the square's own axes: x runs to the right and y
upwards from the reference corner, at the lower left. A pixel of a panel has the mean colour of the
elements under it: marks cover as much of the picture as of the surface.
"""

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
from PIL import Image

from gstlib.coupling import outline, places_of
from gstlib.figures.style import DPI, MM_TO_UM, PALE, VERMILION
from gstlib.surface import spacing_of

__all__ = ["CHANGE_MAP", "FORCE_MAP", "HEIGHT_MAP", "OUTLINE", "colour_bar", "draw_footprints"]
__all__ += ["draw_forces", "draw_heights", "draw_map", "height_norm", "mark_corner"]
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
        What to draw in place of heights. NaN stays pale.
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
    values = field.values * MM_TO_UM if values is None else values
    norm = norm or height_norm(field)
    picture = cmap(norm(values), bytes=True)[..., :3]
    for colour, mask in {PALE: np.isnan(values), **(marks or {})}.items():
        picture[np.asarray(mask, dtype=bool)] = np.round(np.multiply(to_rgb(colour), 255))
    image = Image.fromarray(picture)
    inches = axes.get_position(original=True).size * axes.figure.get_size_inches()
    pixels = round(float(min(inches)) * DPI)
    image.thumbnail((pixels, pixels), Image.Resampling.BOX, reducing_gap=None)
    dy, dx = spacing_of(field)
    left, right = float(field.x[0]) - dx / 2, float(field.x[-1]) + dx / 2
    bottom, top = float(field.y[0]) - dy / 2, float(field.y[-1]) + dy / 2
    axes.imshow(
        np.asarray(image),
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

    `patches` has ``patch, x_mm, y_mm, rotation_deg`` and optionally ``in_study``.
    """
    half = patch_size_mm / 2
    studied = patches.get("in_study", pd.Series(True, patches.index))
    for (patch, place), is_studied in zip(places_of(patches).items(), studied, strict=True):
        look = {"edgecolor": colour, "linestyle": "-" if is_studied else "--"}
        corners = outline(place, patch_size_mm)
        axes.add_patch(Polygon(corners, fill=False, path_effects=OUTLINE, **look))
        at = place.x_mm - 0.92 * half, place.y_mm + 0.9 * half
        look = {"fontsize": 6.5, "color": colour, "path_effects": OUTLINE}
        axes.text(*at, patch, ha="left", va="top", **look)
